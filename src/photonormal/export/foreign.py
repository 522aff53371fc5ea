"""Normal maps that come from elsewhere: which channels hold what, which way they look, and which pixels have a normal.

Whatever has a direction is a normal. Background is what is black, white, mid-grey or transparent. What the numbers say
is done and reported; where they leave a doubt that would spoil the normals, the map is refused, and the message names
the option that settles it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from photonormal.curl import Curl
from photonormal.export.vectors import decoded_vectors, is_background, is_transparent, zero_at_its_code
from photonormal.files.decode import full_scale
from photonormal.geometry import FRAMES, from_frame, normalised
from photonormal.types import InputError, Normals

AUTO = "auto"
CHANNELS = {AUTO: "", "xyz": "012", "xy": "01", "wy": "31"}  # which ones hold x, y and, if there are three, z
LEAST = 0.9  # share of the pixels that are no background, at which a map is taken for one
LONGEST = 1.25  # of a vector that is still taken for a normal
BEHIND = -0.2  # z of a normal that is turned away for good; outlines are seen nearly from the side
FITS = 0.05  # by which half of all lengths may be off one without a second thought
LEVEL = 0.15  # of x and y: maps with less are flat, and say little
CERTAIN = 4.0  # standard errors of the curl, from part to part of the map
WORSE = 1.25  # curl of one reading over another's, at which the other is believed
SCATTER = 0.02  # between the channels of a grey picture


@dataclass(frozen=True)
class NormalMapFrame:
    """Normals with y flipped, or as they are (`photonormal.curl.Turned`)."""

    mirrored: bool
    turn_deg: int = 0


AS_IT_IS, FLIPPED = NormalMapFrame(False), NormalMapFrame(True)


def judged(
    samples: np.ndarray,
    path: Path,
    frame: str,
    channels: str,
    mask: Bool[np.ndarray, "h w"] | None,
    partial: bool,
    tell: Callable[[str], object],
) -> Normals:
    """Normals from the samples of a picture, with alpha where it has it: (h, w, 1 to 4).

    Parameters
    ----------
    frame : of the map, a key of photonormal.geometry.FRAMES; "auto": ours, unless its curl or z show otherwise
    channels : a key of CHANNELS
    mask : pixels outside it have no normal
    partial : go on where fewer than LEAST of the pixels hold a normal
    tell : is called with each thing found out
    """
    v, known = _parts(samples, path, channels)
    if mask is not None:
        known &= mask
    if not known.any():
        raise InputError(f"{path} holds nothing but background; a normal map stores (n + 1) / 2 as red, green, blue.")
    step = 2 / full_scale(samples) if samples.dtype.kind == "u" else 0.0
    p = v[known]
    if channels == AUTO:
        _refuse_grey(p, path)
    if p.shape[1] == 2:
        p = _with_z(zero_at_its_code(_with_z(p), step)[:, :2] if step else p)
    else:
        if step:
            p = zero_at_its_code(p, step)
        if channels == AUTO:
            p = _right_z(p, known, path, tell)
    p = from_frame(p, frame) if frame != AUTO else _facing(p, known, path, tell)
    length = np.linalg.norm(p, axis=-1)
    holds = (length < LONGEST) & (length > 0) & (p[:, 2] > BEHIND * length)
    kept = known.copy()
    kept[known] = holds
    _refuse_few(float((holds & (p[:, 2] > 0)).mean()), p, path, partial)
    map = np.zeros((*known.shape, 3), np.float32)
    map[kept] = normalised(p[holds].astype(np.float64))
    if frame == AUTO and _certainly(map, kept, worse=AS_IT_IS, better=FLIPPED):
        tell(
            f"{path}: green points down, as the slopes' curl shows, so it is read as --frame directx; --frame opengl "
            "reads it as it is."
        )
        map = from_frame(map, "directx")
    tell(
        f"{path}: {int(kept.sum())} normals, on {100 * float(holds.mean()):.1f} % of the pixels that are not "
        f"background ({100 * float(known.mean()):.1f} % of the picture)."
    )
    return Normals(map, kept)


def _parts(samples: np.ndarray, path: Path, channels: str) -> tuple[np.ndarray, np.ndarray]:
    """The parts of vectors (h, w, 2 or 3), and where the picture is no background."""
    chosen = [int(c) for c in CHANNELS[channels]] or [0, 1, 2]
    if samples.shape[2] <= max(chosen):
        raise InputError(
            f"{path} has {samples.shape[2]} channels, so it is no normal map as (n + 1) / 2 in red, green, blue; give "
            "one, or --channels xy where x and y are the first two."
        )
    v = decoded_vectors(samples)
    background = is_background(v[..., chosen])
    if samples.shape[2] == 4 and 3 not in chosen:
        background |= is_transparent(samples[..., 3])
    return v[..., chosen], ~background


def _with_z(xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 3"]:
    z = np.sqrt(np.maximum(1 - (xy[:, :2] ** 2).sum(-1), 0))
    return np.concatenate([xy[:, :2], z[:, None]], axis=-1)


def _refuse_grey(p: Float[np.ndarray, "p c"], path: Path) -> None:
    if p.shape[1] == 3 and float((np.ptp(p, axis=-1) < SCATTER).mean()) > 0.99:
        raise InputError(
            f"{path} is grey: a height map or a mask, no normal map; give one, which stores (n + 1) / 2 as red, "
            "green, blue."
        )


def _right_z(p: Float[np.ndarray, "p 3"], known: np.ndarray, path: Path, tell: Callable) -> Float[np.ndarray, "p 3"]:
    """Vectors whose z is what blue stores: z, or (z + 1) / 2; InputError where it stores neither."""
    r = np.linalg.norm(p[:, :2], axis=-1)
    low, high = np.quantile(p, [0.05, 0.95], axis=0)
    if float(np.ptp(p[:, 2])) < SCATTER and float((high - low)[:2].max()) > LEVEL:
        raise _no_blue(path, "is the same everywhere")
    steep = r > min(LEVEL, float(np.quantile(r, 0.5)))
    off = float(np.median(np.abs(np.linalg.norm(p[steep], axis=-1) - 1))) if steep.any() else 0.0
    from_zero = np.concatenate([p[:, :2], (p[:, 2:] + 1) / 2], axis=-1)
    off_zero = float(np.median(np.abs(np.linalg.norm(from_zero[steep], axis=-1) - 1))) if steep.any() else 1.0
    if off_zero < min(FITS / 2, off / 2):
        tell(f"{path}: blue stores z from 0 to 1, by the vectors' lengths; --channels xyz reads it from -1 to 1.")
        return from_zero
    if off > FITS and float((r < 1.02).mean()) > 0.99:
        given, without = (_curl(x, known) for x in (p, _with_z(p)))
        if given is None or without is None or given > WORSE * without:
            raise _no_blue(path, "does not fit")
    return p


def _no_blue(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: blue {what}, so it holds no z, or this is no normal map; --channels xy takes x and y from red and "
        "green and finds z, --channels xyz reads blue all the same."
    )


def _curl(p: Float[np.ndarray, "p 3"], known: Bool[np.ndarray, "h w"]) -> float | None:
    """Curl of the slopes over all their change, 0 to about 1; None where too few are known."""
    map = np.zeros((*known.shape, 3), np.float32)
    map[known] = p
    curl = Curl.of(map, known)
    return None if curl is None else min(curl.total(AS_IT_IS), curl.total(FLIPPED))


def _facing(p: Float[np.ndarray, "p 3"], known: np.ndarray, path: Path, tell: Callable) -> Float[np.ndarray, "p 3"]:
    """Vectors that look to the camera: where nearly all look away, in the frame that their curl fits."""
    if float((p[:, 2] < 0).mean()) < LEAST:
        return p
    map = np.zeros((*known.shape, 3), np.float32)
    map[known] = from_frame(p, "z-away")
    for frame, worse, better in (("z-away", FLIPPED, AS_IT_IS), ("y-down", AS_IT_IS, FLIPPED)):
        if _certainly(map, known, worse=worse, better=better):
            tell(f"{path}: its normals look away from the camera; by their curl it is read as --frame {frame}.")
            return from_frame(p, frame)
    raise InputError(
        f"{path}: its normals look away from the camera; say which they are: --frame y-down (y down, z into the scene) "
        "or --frame z-away (y up, z into the scene)."
    )


def _certainly(map: np.ndarray, known: np.ndarray, worse: NormalMapFrame, better: NormalMapFrame) -> bool:
    """Whether the slopes are far more a surface's in the one reading than in the other, all over the map."""
    curl = Curl.of(map, known)
    if curl is None:
        return False
    return curl.total(worse) > WORSE * curl.total(better) and curl.certainty(worse, better) > CERTAIN


def _refuse_few(share: float, p: Float[np.ndarray, "p 3"], path: Path, partial: bool) -> None:
    if share >= LEAST or (partial and share > 0):
        return
    facing = {name: float((from_frame(p, name)[:, 2] > 0).mean()) for name in FRAMES}
    best = max(facing, key=lambda name: facing[name])
    if facing["opengl"] < LEAST <= facing[best]:
        what = f"they face the camera by --frame {best}"
    elif float((np.linalg.norm(p[:, :2], axis=-1) < 1.02).mean()) > 0.99:
        what = "red and green may hold x and y and blue something else, which --channels xy leaves aside"
    else:
        what = "it may be no normal map, which stores (n + 1) / 2 as red, green, blue"
    raise InputError(
        f"{path}: {100 * share:.0f} % of the pixels that are no background hold normals but {100 * LEAST:.0f} % are "
        f"needed: {what}; correct it, or add --partial to take those."
    )
