"""From photographs to a mask on disk."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from photonormal.capture.images import ImageFiles
from photonormal.capture.pictures import evenly
from photonormal.disk import at_once, refuse_taken
from photonormal.rig.pictures import images_of, numbered_pictures

MASK_PICTURES = 16  # that a mask is found from, at most


class DrawnMask(NamedTuple):
    """Where the mask and a preview of it were written, and what is said of other things that stand out; "": nothing."""

    mask: Path
    preview: Path
    left_out: str


def draw_mask(folder: str | Path, out: str | Path = "mask.png", overwrite: bool = False) -> DrawnMask:
    """The object's mask from its shading, and a preview of it, as pictures."""
    from photonormal.calibration.mask import things_from_shading
    from photonormal.png import encode_mask, encode_png

    out = Path(out)
    shown = out.with_name(f"{out.stem}_preview.png")
    refuse_taken([out, shown], overwrite)
    paths = numbered_pictures(Path(folder))
    refuse_taken([out, shown], overwrite, paths)
    some = evenly(paths, MASK_PICTURES)
    images = ImageFiles(some, None, np.ones((len(some), 1)))
    pictures = np.stack(images_of(images, lambda image: image.mean(-1)))
    mask, *others = things_from_shading(pictures)
    level = np.quantile(pictures, 0.9, axis=0)
    grey = np.rint(255 * (level / max(float(np.quantile(level, 0.99)), 1e-12)).clip(0, 1) ** (1 / 2.2))
    preview = np.repeat(grey[..., None], 3, axis=-1)
    preview[~mask] = preview[~mask] / 3 + np.array([0, 0, 90])
    with at_once(out.parent) as batch:
        batch.write(out.name, encode_mask(mask))
        batch.write(shown.name, encode_png(preview.astype(np.uint8)))
    return DrawnMask(out, shown, _said(others))


def _said(others: list[Bool[np.ndarray, "h w"]]) -> str:
    """Of the largest thing besides the object, where it is; and how many there are."""
    if not others:
        return ""
    rows, columns = np.nonzero(others[0])
    more = f", and {len(others) - 1} more" if len(others) > 1 else ""
    return (
        f"only the largest thing is in the mask: another stands out around {columns.mean():.0f},{rows.mean():.0f} "
        f"({100 * others[0].mean():.1f} % of the frame){more}. Where one of those is the object, paint the mask with "
        "`photonormal view FOLDER`."
    )
