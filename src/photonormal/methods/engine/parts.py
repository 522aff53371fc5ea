"""A capture's rows solved apart, by processes that each have the whole capture before them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from photonormal.masked import box_of
from photonormal.methods.contract import Method, Solution, Streaming
from photonormal.methods.engine import not_dark
from photonormal.types import Capture

STEP = 64  # rows between two places that a part may end at: a multiple of every network's stride
LEAST = 512  # rows of a part: of fewer, a network would see more of the neighbours than of the part


def divisible(method: Method, capture: Capture) -> bool:
    """Whether rows may be solved apart: not where a method looks at the whole object or finds its lights, nor near
    lamps, whose light depends on the whole surface."""
    needs = method.needs
    whole = needs.reads == "object" or needs.optimises or needs.finds_lights
    return not (whole or (isinstance(method, Streaming) and method.fast)) and capture.lamps is None


def divided(method: Method, capture: Capture, count: int) -> list[slice]:
    """Rows of the frame in at most `count` parts, with about as many pixels on the mask each; one part where they may
    not be solved apart."""
    height, box = len(capture.mask), box_of(capture.mask)[0]
    before = np.cumsum([0, *np.count_nonzero(capture.mask, axis=1)])  # pixels above each row
    ends = [0]
    if divisible(method, capture):
        places = np.arange(box.start + LEAST, box.stop - LEAST + 1, STEP)
        for wanted in before[-1] * np.arange(1, count) / count if len(places) else ():
            place = int(places[np.abs(before[places] - wanted).argmin()])
            if place - max(ends[-1], box.start) >= LEAST:
                ends.append(place)
    return [slice(a, b) for a, b in zip(ends, [*ends[1:], height], strict=True)]


def joined(parts: Sequence[Solution], capture: Capture) -> Solution:
    """The solution of a whole capture from those of its parts, in their order.

    Raises
    ------
    InputError
        If no light reached any pixel.
    """
    return not_dark(Solution.joined(parts), capture)
