"""Saturation, darkness and bits of the photographs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from photonormal.doctor.finding import Finding, counted
from photonormal.doctor.samples import Samples
from photonormal.srgb import from_linear
from photonormal.types import Capture, a_few

SATURATED = 0.05  # of a picture's samples
BLACK = 0.05  # level of a picture, as part of that of a bright one, below which its lamp was off
BRIGHT = 0.75  # quantile of all pictures' levels that is a bright one's: most lamps may have been off
CLIPPED = 0.125  # of all samples at zero
MOSTLY, ZERO = 2 / 3, 0.25  # of the pictures in which a pixel is black, and of such pixels: facing away is no fault
DIM, DIM_ENCODED = 0.04, 0.1  # median level in the files, of full scale, below which 8 bits spoil slopes equally much


def saturation(samples: Samples, capture: Capture) -> list[Finding]:
    """Pictures that reach white."""
    bad = np.flatnonzero(samples.saturated > SATURATED)
    if not bad.size:
        return []
    worst = bad[np.argsort(-samples.saturated[bad])]
    names = [capture.image_names[j] for j in worst]
    return [
        Finding(
            "saturation",
            bool(samples.saturated.mean() > SATURATED),
            f"{counted(len(bad), 'picture is', 'pictures are')} saturated on more than {100 * SATURATED:.0f} % of the "
            f"object ({a_few(names)}; up to {100 * samples.saturated[worst[0]]:.0f} %); "
            "expose less, or trim highlights.",
            {"pictures": names, "saturated_percent": round(100 * float(samples.saturated.mean()), 2)},
        )
    ]


def darkness(I: Float[np.ndarray, "p n"], names: Sequence[str]) -> list[Finding]:
    """Pictures without light, and objects that most pictures leave black, by grey levels of the object."""
    found = []
    black = np.flatnonzero(I.mean(0) < BLACK * np.quantile(I.mean(0), BRIGHT))
    if black.size:
        off = [names[j] for j in black.tolist()]
        found.append(
            Finding(
                "darkness",
                True,
                f"{counted(len(black), 'picture is', 'pictures are')} black ({a_few(off)}): the lamp was off or "
                "points elsewhere; choose the other pictures with --images, or photograph these again.",
                {"pictures": off},
            )
        )
    lit = np.delete(I, black, axis=1)
    dark = float(((lit <= 0).mean(1) > MOSTLY).mean()) if lit.size else 0.0
    if dark > ZERO:
        found.append(
            Finding(
                "darkness",
                True,
                f"{100 * dark:.0f} % of the object is black in most pictures; expose more, use files of more bits, or "
                "check that the mask covers the object only.",
                {"dark_percent": round(100 * dark, 2)},
            )
        )
    return found


def bits(samples: Samples, I: Float[np.ndarray, "p n"], capture: Capture) -> list[Finding]:
    """Pictures of eight bits, and whether they hold enough of them, by grey levels of the object."""
    if samples.bits != 8:
        return []
    full = 1.0 if capture.saturation is None else capture.saturation.mean(1)  # (n,)
    level = np.array(np.median(np.median(I, axis=0) / full))
    level = float(from_linear(level) if capture.linearised else level)  # as the files hold it
    clipped = float(samples.saturated.mean()) > SATURATED / 5 or float((I <= 0).mean()) > CLIPPED
    dim = level < (DIM_ENCODED if capture.linearised else DIM)
    if not (dim or clipped):
        return []
    kind = (
        "16-bit files hold 8-bit samples" if getattr(capture.images, "dtype", None) == np.uint16 else "8-bit pictures"
    )
    what = f"half of the samples lie below level {255 * level:.0f} of 255" if dim else "clipped at black or white"
    return [
        Finding(
            "bits",
            dim,
            f"{kind}, {what}; photograph RAW or export 16-bit TIFF or PNG"
            f"{', and expose more' if dim else ', and keep highlights and shadows inside the range'}.",
            {"bits": 8, "median_level": round(level, 4)},
        )
    ]
