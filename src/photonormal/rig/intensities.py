"""From photographs of a board, or of the object itself, to the lights' intensities on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from photonormal.capture import files_behind, files_read, load
from photonormal.capture.assemble import Choice, corrected
from photonormal.capture.corrections import MOST_WHITE
from photonormal.capture.encoding import encodings
from photonormal.capture.exif import exposures
from photonormal.capture.images import ImageFiles, files_of
from photonormal.disk import at_once, refuse_taken
from photonormal.progress import progress
from photonormal.rig.pictures import pictures_for
from photonormal.types import Capture, InputError

if TYPE_CHECKING:
    from photonormal.doctor.given import Near

REFERENCE_PIXELS = 3000  # of the object that intensities are found from


def intensities(
    capture: str | Path,
    out: str | Path = "light_intensities.txt",
    reference: str | Path | None = None,
    region: str = "",
    overwrite: bool = False,
    **how: Any,
) -> np.ndarray:
    """Intensities (n, c) of a capture's lights, their mean 1, written as a table.

    Parameters
    ----------
    capture : folder or `.lp` file, as for `photonormal.load`, which `how` is passed on to; of near lamps the object's
        own shading shows what they send out, the board what arrives at its distance
    out : `light_intensities.txt`, which is read where it lies beside the photographs
    reference : folder with photographs of a matt white or grey board that faces the camera, under the same lights in
        the same order, or of the same names; read and corrected as the object's. Without it and `region`, intensities
        are found from the object's own shading
    region : "x0,y0,x1,y1" in pixels: where the board is, in the reference's photographs or in the object's; the whole
        frame of the reference without it
    """
    from photonormal.export import lights as text

    out = Path(out)
    refuse_taken([out], overwrite)
    photographs = load(capture, **how)
    refuse_taken([out], overwrite, files_read(capture, photographs, *how.values()))
    L = photographs.known_lights()
    if (flat := how.get("flat")) and Path(flat).is_dir():
        raise InputError(f"--flat {flat} shows the lights' intensities already; leave it out to find them another way.")
    with progress("intensities"):
        if reference is not None or region:
            e = _by_board(photographs, Path(reference if reference is not None else capture), region, L, how)
        else:
            e = _by_shading(photographs, L) * _given(photographs, bool(how.get("exif_exposure")))
            e = e / e.mean()
    with at_once(out.parent) as batch:
        batch.write(out.name, text.table(e))
    return e


def _given(photographs: Capture, exposed: bool) -> Float[np.ndarray, "n c"]:
    """Intensities that the photographs were divided by, which those that are found of them come on top of.

    Without what they were `exposed` by Exif: that stays an option of its own.
    """
    files = files_behind(photographs)
    return files.intensities / (exposures([files_of(p)[0] for p in files.pictures]) if exposed else 1)


def _by_board(
    photographs: Capture, place: Path, region: str, L: np.ndarray, how: dict[str, Any]
) -> Float[np.ndarray, "n c"]:
    """Intensities from the pictures of a board, one for each photograph, read and corrected as these are."""
    from photonormal.calibration.intensities import from_reference

    paths = pictures_for(photographs.image_names, place, "the board")
    said = encodings(paths, bool(how.get("srgb")), bool(how.get("linear")))
    files = ImageFiles(paths, None, exposures(paths) if how.get("exif_exposure") else np.ones((len(paths), 1)), said)
    dark, flat = (Path(how[name]) if how.get(name) else None for name in ("dark", "flat"))
    choice = Choice(dark=dark, flat=flat, hot_pixels=bool(how.get("hot_pixels")))
    images = corrected(files, choice, None, None, None)
    board = Capture(images, saturation=files.saturation, image_names=tuple(p.name for p in paths))
    rows, columns = box = _region(region, images.shape[1:3])

    def level(j: int) -> np.ndarray:
        shown = board.window(j, *box)
        if board.saturated(j, rows, columns, shown).mean((0, 1)).max() > MOST_WHITE:
            raise InputError(
                f"{paths[j].name} of {place} is white where the board is, so its light can't be "
                "measured; expose less, and photograph it again."
            )
        return np.median(shown, axis=(0, 1))

    return from_reference(np.stack(board.each_image(level)), str(place), np.array([0.0, 0, 1]), L)


def _by_shading(photographs: Capture, L: np.ndarray) -> np.ndarray:
    """Intensities (n, c) from the object's own shading; of near lamps, what they send out."""
    from photonormal.calibration.intensities import self_calibrated
    from photonormal.doctor.given import Near

    c = photographs.images.shape[3]
    inside = np.flatnonzero(photographs.mask)
    some = slice(None, None, max(1, inside.size // REFERENCE_PIXELS))
    I = np.stack(photographs.map_images(lambda _, image: image.reshape(-1, c)[inside[some]]), axis=1)
    lit = np.all((I > 0).any(1), axis=-1)
    I = I[lit].astype(np.float64)  # (p, n, c)
    if len(I) < 100:
        raise InputError(f"{photographs.name} shows too little light on the object to find intensities from.")
    lamps, camera = photographs.lamps, photographs.camera
    if lamps is None or camera is None:
        return np.stack([self_calibrated(I[..., k], L)[0] for k in range(c)], axis=-1)
    X = camera.flat_mm(photographs.mask)[some][lit]
    return np.stack([_of_lamps(Near(I[..., k], X, lamps)) for k in range(c)], axis=-1)


def _of_lamps(near: Near) -> np.ndarray:
    """Intensities (n,) of near lamps themselves, without their distance, for an object that is nearly flat."""
    from photonormal.calibration.intensities import self_calibrated

    e = np.ones(len(near.vectors))
    for _ in range(3):  # how light falls off over the object is found from pictures of equal lamps
        e = e * self_calibrated(near.showing(near.levels / e).seen(), near.directions())[0]
    return e


def _region(text: str, shape: Sequence[int]) -> tuple[slice, slice]:
    if not text:
        return slice(0, shape[0]), slice(0, shape[1])
    try:
        x0, y0, x1, y1 = (int(v) for v in text.split(","))
    except ValueError:
        raise InputError(
            f"--region {text[:40]!r} came but x0,y0,x1,y1 in whole pixels is needed; correct it."
        ) from None
    if not (0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0]):
        raise InputError(f"--region {text} lies outside the photographs of {shape[1]} x {shape[0]} pixels; correct it.")
    return slice(y0, y1), slice(x0, x1)
