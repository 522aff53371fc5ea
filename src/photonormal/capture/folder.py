"""A plain folder of photographs.

my-object/
    any names, any picture format      in natural order: image 10 comes after image 9; the pages of a TIFF stack
    light_directions.txt               n x 3 or 3 x n; or lights.csv and other forms (`photonormal.capture.lights`);
                                       names in it choose and order the pictures
    light_intensities.txt              n x 1 or n x 3; optional
    filenames.txt                      the pictures in the order of the lights; optional
    mask.*                             white on the object; optional
    Normal_gt.mat                      true normals; optional
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from photonormal.capture.assemble import Choice, assemble
from photonormal.capture.diligent import read_normals
from photonormal.capture.lights import own_lights, read_lights
from photonormal.capture.lights.match import left_out, located
from photonormal.capture.pictures import (
    find_mask,
    find_pictures,
    no_pictures,
    photographs,
    picture_files,
    pictures_below,
    unnamed,
)
from photonormal.capture.texts import beside, read_lines
from photonormal.types import Capture, InputError


def matches(path: Path) -> bool:
    """True for any folder: it is the last reader asked."""
    return path.is_dir()


def read(path: Path, choice: Choice, lights: Path | None = None) -> Capture:
    """Pictures of the folder with the lights that the user names, that the file `lights` holds, or that lie beside."""
    given = choice.lights is not None or choice.ring is not None
    own = lights or (None if given else own_lights(path))
    listed = None if own is None else read_lights(own, "" if given else choice.lights_as)
    pictures: list[Path] = []
    if os.path.lexists(path / "filenames.txt"):
        pictures = [beside(path, name) for name in read_lines(path / "filenames.txt")]
    elif own is not None and listed is not None and listed.names:
        there = picture_files(path)
        there = there if photographs(there) else pictures_below(path)
        named = located(listed.names, own.parent, there)
        if any(map(os.path.isfile, named)):
            others = left_out(unnamed(there, [*named, *choice.not_pictures()]), listed)
            pictures, listed = named, replace(listed, names=[], notes=(*listed.notes, *others))
    pictures = pictures or find_pictures(path, [own, *choice.not_pictures()], choice.prefer)
    if not pictures:
        raise no_pictures(path)
    if own is None and not given:
        raise InputError(
            f"{path} has {len(pictures)} pictures but no light_directions.txt, lights.csv or .lp; add one, or name a "
            "file with --lights, or get one from a mirror sphere with `photonormal calibrate`, or say where the lamps "
            "stand with --ring, or have lights found from the object with --lights unknown."
        )
    intensities, truth = path / "light_intensities.txt", path / "Normal_gt.mat"
    return assemble(
        name=path.resolve().name,
        pictures=pictures,
        lights=listed,
        intensities=intensities if os.path.lexists(intensities) else None,
        mask=find_mask(path) if choice.mask is None else None,
        truth=(lambda frame: read_normals(truth, frame)) if os.path.lexists(truth) else None,
        choice=choice,
    )
