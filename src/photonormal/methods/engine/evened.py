"""Pictures that a method finds clearly brighter or darker than their lights' intensities say are divided by that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from photonormal.lighting import under
from photonormal.methods.contract import Observations, Streaming
from photonormal.methods.engine.looks import looked_at
from photonormal.methods.engine.samples import grey_levels
from photonormal.methods.inputs.grey import Levels
from photonormal.types import Capture, a_few

NAMED = 3  # pictures, at most


def evened(capture: Capture, method: Streaming) -> Capture:
    """The capture with such pictures divided, which its notes say; itself where there are none, or lamps are near."""
    if capture.lamps is not None:
        return capture
    factors = method.brightened(lambda: some_of(capture))
    if factors is None or (factors == 1).all():
        return capture
    e = factors.double().numpy()
    return replace(under(capture, None, e), notes=(*capture.notes, note(e, capture.image_names)))


def some_of(capture: Capture) -> Observations:
    """Some of its pixels, as a method is shown them."""
    where = looked_at(capture.mask)
    I = grey_levels(capture, where)
    levels, L = Levels.of(I), torch.from_numpy(capture.known_lights())
    return Observations(levels.cut_(I), levels.lit(I), L, mask=torch.from_numpy(where))


def note(e: Float[np.ndarray, " n"], names: Sequence[str]) -> str:
    """What was done, of the pictures that are furthest off first."""
    worst = np.argsort(-np.abs(np.log(e)))[: np.count_nonzero(e != 1)]
    said = a_few([f"{names[j]} x {e[j]:.2f}" for j in worst], NAMED)
    one = len(worst) == 1
    return (
        f"{len(worst)} {'picture is' if one else 'pictures are'} brighter or darker than the lights' intensities say "
        f"({said}); {'it was' if one else 'each was'} divided by that."
    )
