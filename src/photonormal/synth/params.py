"""Tables of scene parameters: dataclasses of tensors whose first axis is the scene."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

P = TypeVar("P")


def rng(*key: int) -> np.random.Generator:
    """Random numbers that depend on nothing but `key`: (seed, purpose, block, ...)."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(key)))


def take(params: P, scenes: Any) -> P:
    """The rows `scenes` (a slice, indices or a mask) of every tensor."""
    return _each(params, lambda x: x[scenes])


def to_device(params: P, device: torch.device) -> P:
    """All tensors on `device`."""
    return _each(params, lambda x: x.to(device))


def _each(params: Any, f: Any) -> Any:
    def change(value: Any) -> Any:
        if isinstance(value, Tensor):
            return f(value)
        return _each(value, f) if dataclasses.is_dataclass(value) else value

    return type(params)(**{k.name: change(getattr(params, k.name)) for k in dataclasses.fields(params)})


def tensor(values: Any) -> Tensor:
    """float32 tensor of drawn numbers; booleans and integers keep their kind."""
    array = np.asarray(values)
    return torch.from_numpy(array.astype(np.float32) if array.dtype.kind == "f" else array)


def log_uniform(g: np.random.Generator, low: Any, high: Any, shape: Any) -> np.ndarray:
    """Numbers whose logarithm is uniform over [low, high]."""
    return np.asarray(np.exp(g.uniform(np.log(low), np.log(high), shape)))


def unit_vectors(g: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Uniform over the sphere: (*shape, 3)."""
    v = g.normal(size=(*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def rotations(g: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Uniform rotations (*shape, 3, 3), from unit quaternions."""
    w, x, y, z = np.moveaxis(g.normal(size=(*shape, 4)), -1, 0)
    s = 2 / (w * w + x * x + y * y + z * z)
    rows = [
        [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def indices(chosen: Bool[Tensor, "b p"]) -> Tensor:
    """Indices of the chosen ones in each row, filled up with others where a row has fewer: (b, most of any row)."""
    if chosen.shape[0] == 1:
        i = chosen.nonzero()[:, 1][None]
        return i if i.numel() else i.new_zeros(1, 1)
    count = max(1, int(chosen.sum(1).max()))
    return chosen.to(torch.int8).argsort(dim=1, descending=True, stable=True)[:, :count]
