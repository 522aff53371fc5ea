"""A result under other lights: one picture, or a film of a light that goes around it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from photonormal.disk import at_once, refuse_taken
from photonormal.export.folder import result_files
from photonormal.export.normal_maps import told_frame
from photonormal.export.pictures import albedo_samples, is_encoded, linear
from photonormal.files.opening import read_npz
from photonormal.files.rows import Rows, npz_rows
from photonormal.geometry import from_frame
from photonormal.handover.opened import photographs_needed
from photonormal.handover.surfaces import picture_rows
from photonormal.masked import box_of
from photonormal.png import SRGB, encode_png
from photonormal.progress import progress
from photonormal.relighting import FORMATS, films
from photonormal.relighting.pictures import Relit, direction, matt, relit_by_fit
from photonormal.relighting.web import jpeg
from photonormal.types import InputError, Normals
from photonormal.view.result import report_of

log = logging.getLogger(__name__)

ELEVATION = 45.0  # degrees, of a sweep unless said
STEPS = 72  # of a light that goes around
SIDE = 960  # pixels of a film's longer side, at most
STILLS = (".png", ".jpg", ".jpeg")
MATT = "matt"  # by normals and albedo alone
FITS = ("hsh", "ptm", "hsh16")
STRETCHED = 8  # weights of the photographs, all positive, above which a picture shows what none of them does


def export_relit(
    result: Path,
    out: Path,
    angles: str = "",
    sweep: bool = False,
    by: str = "hsh",
    capture: Path | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a result as it looks under one light (.png, .jpg), or under a light that goes around it once (.mp4, .gif).

    Parameters
    ----------
    result : a folder that `measure` wrote
    out : the file to write
    angles : "azimuth,elevation" of the light in degrees: 0,30 is from the right, 90,30 from above; where a sweep begins
    sweep : write a film
    by : "hsh", "ptm" or "hsh16", the fit to the photographs; "matt": normals and albedo, without gloss and cast shadows
    capture : the photographs, where they are not where the report says
    overwrite : replace a file that exists

    Raises
    ------
    InputError
        If the angles or the file's ending are none, or what the picture is made from is not there.
    """
    azimuth, elevation = _angles(angles)
    endings = films.FORMATS if sweep else STILLS
    if out.suffix.lower() not in endings:
        raise InputError(
            f"--out {out} ends in {out.suffix!r} but {' or '.join(endings)} is written; choose such a name."
        )
    if by not in (*FITS, MATT):
        raise InputError(f"--by {by[:40]!r} came but {', '.join(FITS)} or {MATT} is needed; choose one.")
    refuse_taken([out], overwrite, of_result=result_files(result))
    lights = [direction(azimuth + 360 * step / STEPS, elevation) for step in range(STEPS if sweep else 1)]
    with (
        _matt(result) if by == MATT else _fitted(result, capture, by, lights, out, overwrite) as relit,
        at_once(out.parent) as to,
    ):
        if not sweep:
            picture = relit(lights[0])
            to.write(out.name, encode_png(picture, SRGB) if out.suffix.lower() == ".png" else jpeg(picture))
            return out
        small = relit.reduced(SIDE, multiple=2)
        with progress("film", STEPS) as advance:

            def frames() -> Iterator:
                for light in lights:
                    yield small(light)
                    advance()

            to.write(out.name, films.encoded(frames(), out.suffix.lower()))
    return out


def _angles(text: str) -> tuple[float, float]:
    try:
        azimuth, elevation = (float(part) for part in (text or f"0,{ELEVATION}").split(","))
    except ValueError:
        azimuth, elevation = 0.0, float("nan")
    if not (abs(azimuth) <= 360 and 0 < elevation <= 90):
        raise InputError(
            f"--relit {text[:40]!r} came but azimuth,elevation in degrees is needed, the elevation above 0 and up to "
            "90, such as 45,30; correct it."
        )
    return azimuth, elevation


@contextmanager
def _fitted(
    result: Path, capture: Path | None, by: str, lights: list[np.ndarray], out: Path, overwrite: bool
) -> Iterator[Relit]:
    photographs, read = photographs_needed(result, capture, f"--by {by} is", otherwise="or choose --by matt")
    refuse_taken([out], overwrite, read)
    known, basis = photographs.known_lights(), FORMATS[by].basis
    with relit_by_fit(photographs, basis) as relit:
        if (np.abs(basis(np.stack(lights)) @ np.linalg.pinv(basis(known))).sum(1) > STRETCHED).any():
            lowest, highest = np.degrees(np.arcsin(np.clip([known[:, 2].min(), known[:, 2].max()], -1, 1)))
            log.warning(
                "photonormal: the photographs show lights at elevations of %.0f to %.0f degrees; far from them the "
                "picture is a guess. Ask for a light nearer to theirs, or choose --by matt.",
                lowest,
                highest,
            )
        yield relit


@contextmanager
def _matt(result: Path) -> Iterator[Relit]:
    report_of(result)
    path, file = result / "normals.npz", result / "albedo.png"
    if not file.is_file():
        raise InputError(f"{result} holds no albedo.png, which --by matt needs; measure again.")
    colours = albedo_samples(file)
    with npz_rows(path, "measure again", ("normals", "mask")) as found:
        if found.keys() != {"normals", "mask"}:
            raise InputError(f"{path} holds no normals and mask; measure again.")
        mask = found["mask"][:]
        if colours.shape[:2] != mask.shape:
            raise InputError(f"{file} is {colours.shape[:2]} but {path.name} beside it is {mask.shape}; measure again.")
        frame = told_frame(read_npz(path, "measure again", ("axes",)).get("axes"), path)
        lines, columns = box_of(mask)
        size, encoded = (lines.stop - lines.start, columns.stop - columns.start), is_encoded(file, colours)
        with Rows((*size, 3), np.float32) as normals, Rows((*size, 3), np.float32) as albedo:
            for rows in picture_rows(*size):
                inside = slice(lines.start + rows.start, lines.start + rows.stop)
                part = Normals(found["normals"][inside][:, columns], mask[inside, columns]).map
                normals[rows] = part if frame is None else from_frame(part, frame)
                albedo[rows] = linear(colours[inside, columns], encoded)
            yield matt(normals, albedo)
