"""Photographs of a few rows or columns: to a network the frame's border would be the object's outline all along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from photonormal.methods.contract import Solution
from photonormal.methods.engine.halved import Some
from photonormal.types import Capture

NARROW = 8  # rows or columns; of more the border is a small part
AROUND = 4  # pixels by which the border is repeated outwards


def is_narrow(capture: Capture) -> bool:
    """Whether photographs have so few rows or columns."""
    return min(capture.mask.shape) < NARROW


def with_border(solve: Callable[[Capture], Solution], capture: Capture, rows: slice | None = None) -> Solution:
    """What is found of narrow photographs, or of some rows of them, whose border is repeated around them."""
    sides = (np.arange(-AROUND, side + AROUND).clip(0, side - 1) for side in capture.mask.shape)
    near = np.ix_(*sides)  # of each pixel, the one in the photographs
    mask = capture.mask[near]
    number = np.cumsum(capture.mask).reshape(capture.mask.shape)[near][mask] - 1
    wide = replace(
        capture,
        images=np.stack(capture.map_images(lambda j, image: image[near])),
        mask=mask,
        lights_at=None if capture.lights_at is None else Some(capture.lights_at, number),
        truth=None,
        camera=None,
        crop=None,
    )
    found = solve(wide)
    asked = np.zeros_like(mask)
    asked[AROUND:-AROUND, AROUND:-AROUND][rows or slice(None)] = True
    wanted = torch.from_numpy(asked[mask])
    told_deg = None if found.told_deg is None else found.told_deg[wanted]
    return replace(found, normals=found.normals[wanted], told_deg=told_deg)
