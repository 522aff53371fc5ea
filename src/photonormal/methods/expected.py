"""How far each normal is expected to be off, in degrees.

What a pixel's samples say about its normal is put into a few numbers (`evidence`): how well a matt surface of that
normal explains them, how much lies in shadow, how well the lights fix a normal, how far two cheap methods disagree;
and what the method itself estimates, where a network does. A calibration of each method, fitted to rendered scenes
(`benchmarks/expected.py --fit`), maps them to a mean error. Of a real object its true normals are known no better than
its scan lies on its pictures, which rendered ones can't teach: where the surface turns, that adds to the error.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.masked import box_of, on_map
from photonormal.methods import name_of, options_of, parse
from photonormal.methods.bend import bend_deg
from photonormal.methods.between import between
from photonormal.methods.contract import Method
from photonormal.methods.engine.near import seen_as_distant
from photonormal.methods.evidence import EVIDENCE, LEAST_TOLD, evidence_of
from photonormal.types import Capture, Normals

FILE = Path(__file__).with_name("expected.json")

# means over the object count, too
OF_ALL = ("usual_residual", "trimmed", "woodham", "uncertainty", "dim", "sides", "halves", "bend")
PRODUCTS = (  # that are terms, too
    *((name, name) for name in ("usual_residual", "woodham", "trimmed", "uncertainty", "slant", "dim", "sides")),
    ("usual_residual", "trimmed"),
    ("trimmed", "uncertainty"),
)
FITTED = 3, 100  # images of the scenes that calibrations were fitted to
EVERY, SPARSEST = 3000, 5  # pixels up to which each one's error is found; of more, one in 25 at least
LARGEST = 2**22  # pixels whose evidence is held; of larger objects so many
SHIFT = 0.35  # by which a real object's true normals lie beside its pictures, in parts of its size, `bend.PART`
PIXELS = 2**16  # whose terms are held at a time


def with_expected_error(
    normals: Normals,
    told_deg: Float[Tensor, " p"] | None,
    capture: Capture,
    method: Method,
    device: torch.device,
    shift: float = SHIFT,
) -> Normals:
    """The normals that a method found, with how far each is expected to be off.

    By the method's calibration; where it has none for these options, by the method's own estimate, `told_deg` of the
    pixels on the capture's mask, if there is one.
    `capture` is the one that was solved, or that one without the fall-off of its near lamps
    (`photonormal.methods.engine.near.seen_as_distant`), which saves doing it again. `shift` is 0 where true normals
    are exact, as rendered ones are.
    """
    told_map = None if told_deg is None else on_map(told_deg.numpy(), capture.mask, np.nan)
    calibration = calibration_of(method)
    if calibration is None:
        return normals if told_map is None else replace(normals, expected_error_deg=told_map)
    step = grid_step(int(normals.mask.sum()), method.needs.reads == "pixels")
    if not normals.mask[::step, ::step].any():
        step = 1
    some = np.zeros_like(normals.mask)
    some[::step, ::step] = normals.mask[::step, ::step]
    shifted = bend_deg(normals)
    F = evidence_of(seen_as_distant(capture, normals), normals, device, told_map, some, shifted)
    found = on_map(calibration(F.cpu().numpy()), some[::step, ::step], np.nan)
    if step > 1 and told_map is None:
        found = between(found, normals.mask, step)
    if step > 1 and told_map is not None:
        told_map = told_map.clip(LEAST_TOLD)  # it differs from pixel to pixel; how far to trust it does not
        found = told_map * between(found / told_map[::step, ::step], normals.mask, step)
    here = shifted[box_of(normals.mask)]
    here *= shift
    np.hypot(found[box_of(normals.mask)], here, out=here).clip(max=90, out=here)
    return replace(normals, expected_error_deg=shifted)


def grid_step(pixels: int, fast: bool) -> int:
    """Rows and columns between the pixels whose errors are found apart.

    So that this costs less than a fast method; else so that what is known of them all at once fits into the memory.
    """
    return min(SPARSEST, int(np.ceil(np.sqrt(pixels / EVERY)))) if fast else int(np.ceil(np.sqrt(pixels / LARGEST)))


@dataclass(frozen=True)
class Calibration:
    """From evidence to degrees: a logarithm linear in `terms`, bent by a rising curve; both fitted at some `images`.

    Between those numbers of images the logarithm is interpolated over theirs; beyond, the nearest is taken.

    Parameters
    ----------
    images : (m,) rising
    weights : (m, 1 + t) the constant's first
    curve : (m, 2, c) ln degrees of the linear form, and what they mean
    """

    images: Float[np.ndarray, " m"]
    weights: Float[np.ndarray, "m t1"]
    curve: Float[np.ndarray, "m 2 c"]

    def __call__(self, F: Float[np.ndarray, "p k"]) -> Float[np.ndarray, " p"]:
        """Expected errors, degrees, 0.05 to 90, of pixels of one capture."""
        images = EVIDENCE.index("images")
        place = np.interp(F[0, images], np.log(self.images), np.arange(len(self.images)))
        k = min(int(place), max(0, len(self.images) - 2))
        after = min(k + 1, len(self.images) - 1)
        found = []
        for first in range(0, len(F), PIXELS):
            part = F[first : first + PIXELS].astype(np.float64)
            part[:, images] = part[:, images].clip(*np.log(FITTED))
            T = terms(part, F)
            low, high = (np.interp(linear(T, self.weights[i]), *self.curve[i]) for i in (k, after))
            found.append(np.exp(low + (place - k) * (high - low)).clip(0.05, 90))
        return np.concatenate(found)


def terms(F: Float[np.ndarray, "p k"], whole: Float[np.ndarray, "all k"]) -> Float[np.ndarray, "p t"]:
    """What the logarithm is linear in: evidence of some pixels, means of some of it over the `whole`, products."""
    column = {name: F[:, i] for i, name in enumerate(EVIDENCE)}
    over_all = dict(zip(EVIDENCE, whole.mean(0, dtype=np.float64), strict=True))
    means = [np.full(len(F), over_all[name]) for name in OF_ALL]
    products = [column[a] * column[b] for a, b in PRODUCTS]
    return np.stack([*F.T, *means, *products], axis=1)


def linear(T: Float[np.ndarray, "p t"], weights: Float[np.ndarray, " t1"]) -> Float[np.ndarray, " p"]:
    """The constant and the weighted terms, within ln 90."""
    return np.clip(weights[0] + T @ weights[1:], -8, np.log(90))


@dataclass(frozen=True)
class MadeFor:
    """What a calibration holds for: a method with these options, and weights."""

    options: dict[str, Any]
    weights_sha256: str | None

    @staticmethod
    def of(method: Method) -> MadeFor:
        """A method as it is."""
        return MadeFor(options_of(method), getattr(method, "weights_sha256", None))


def calibration_of(method: Method) -> Calibration | None:
    """The calibration of a method; None where there is none for its options and weights."""
    made = MadeFor.of(method)
    fitting = (text for text, one in made_for().items() if one == made and parse(text)[0] == name_of(method))
    return next((calibrations()[text] for text in fitting), None)


@cache
def _stored() -> dict[str, dict[str, Any]]:
    return json.loads(FILE.read_text())["methods"]


@cache
def calibrations() -> dict[str, Calibration]:
    """By method with options, as ``method:option=value``, as FILE has them."""
    return {
        text: Calibration(*(np.array(one[key], float) for key in ("images", "weights", "curve")))
        for text, one in _stored().items()
    }


@cache
def made_for() -> dict[str, MadeFor]:
    """The same, what each calibration holds for."""
    return {text: MadeFor(**one["made_for"]) for text, one in _stored().items()}
