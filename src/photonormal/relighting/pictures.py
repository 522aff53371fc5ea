"""Pictures of an object under any light: from the fit to its photographs, or from its normals and albedo."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from photonormal.files.rows import Rows
from photonormal.relighting.bases import Basis
from photonormal.relighting.fit import RelightingFit, pieces
from photonormal.srgb import from_linear
from photonormal.types import Capture


@dataclass(frozen=True)
class Relit:
    """What an object looks like under a light.

    Parameters
    ----------
    layers : the parts that a picture is made from, each (h, w, 1 or 3)
    shown : from some rows of them, (k, rows, w, 3), and a unit light to what a screen shows, from 0 to 1
    """

    layers: Sequence[Rows | np.ndarray]
    shown: Callable[[np.ndarray, Float[np.ndarray, " 3"]], np.ndarray]

    def __call__(self, light: Float[np.ndarray, " 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """An RGB picture under a light."""
        picture = np.empty((*self.layers[0].shape[:2], 3), np.uint8)
        for rows, part in pieces(self.layers):
            picture[rows] = np.rint(255 * self.shown(part, light).clip(0, 1))
        return picture

    def reduced(self, side: int, multiple: int = 1) -> Relit:
        """The same with sides of at most `side` pixels, multiples of `multiple`."""
        h, w = self.layers[0].shape[:2]
        scale = min(1.0, side / max(h, w))
        size = [max(multiple, round(scale * length / multiple) * multiple) for length in (w, h)]
        small = (cv2.resize(layer[:], size, interpolation=cv2.INTER_AREA) for layer in self.layers)
        return Relit([layer.reshape(size[1], size[0], -1) for layer in small], self.shown)


@contextmanager
def relit_by_fit(capture: Capture, basis: Basis) -> Iterator[Relit]:
    """By the fit to photographs, cut to the mask's box, black outside it; its coefficients lie on disk."""
    with RelightingFit(capture, basis).layers() as layers:
        yield Relit(layers, lambda C, light: np.tensordot(basis(light).astype(np.float32), C, 1))


def matt(normals: Rows, albedo: Rows) -> Relit:
    """As a matt surface would look, without cast shadows and gloss; `albedo` is linear, from 0 to 1."""

    def shown(layers: np.ndarray, light: np.ndarray) -> np.ndarray:
        cos = np.maximum(layers[0] @ light.astype(np.float32), 0)
        return from_linear((layers[1] * cos[..., None]).clip(0, 1))

    return Relit([normals, albedo], shown)


def direction(azimuth_deg: float, elevation_deg: float) -> Float[np.ndarray, " 3"]:
    """The unit light at an azimuth from x towards y, and an elevation over the plane of the picture."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
