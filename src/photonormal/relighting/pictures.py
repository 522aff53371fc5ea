"""Pictures of an object under any light: from the fit to its photographs, or from its normals and albedo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from photonormal.files.memory import scratch
from photonormal.progress import progress
from photonormal.relighting.bases import Basis
from photonormal.relighting.fit import Fit
from photonormal.srgb import from_linear
from photonormal.types import Capture

ROWS = 256  # of a picture made at a time


@dataclass(frozen=True)
class Relit:
    """What an object looks like under a light.

    Parameters
    ----------
    layers : (k, h, w, 3) the parts that a picture is made from
    shown : from some rows of them, (k, rows, w, 3), and a unit light to what a screen shows, from 0 to 1
    """

    layers: Float[np.ndarray, "k h w 3"]
    shown: Callable[[np.ndarray, Float[np.ndarray, " 3"]], np.ndarray]

    def __call__(self, light: Float[np.ndarray, " 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """An RGB picture under a light."""
        picture = np.empty(self.layers.shape[1:], np.uint8)
        for y in range(0, len(picture), ROWS):
            rows = slice(y, y + ROWS)
            picture[rows] = np.rint(255 * self.shown(np.asarray(self.layers[:, rows]), light).clip(0, 1))
        return picture

    def reduced(self, side: int, multiple: int = 1) -> Relit:
        """The same with sides of at most `side` pixels, multiples of `multiple`."""
        h, w = self.layers.shape[1:3]
        scale = min(1.0, side / max(h, w))
        size = [max(multiple, round(scale * length / multiple) * multiple) for length in (w, h)]
        layers = [cv2.resize(np.asarray(layer), size, interpolation=cv2.INTER_AREA) for layer in self.layers]
        return Relit(np.stack(layers), self.shown)


@contextmanager
def fitted(capture: Capture, basis: Basis) -> Iterator[Relit]:
    """By the fit to photographs, cut to the mask's box, black outside it; its coefficients lie on disk."""
    fit = Fit(capture, basis)
    white = fit.white()
    with scratch((fit.terms, *fit.size, 3), np.float32) as layers:
        with progress("fit to the light", int(capture.mask.sum())) as advance:
            for band in fit.bands(white):
                for j, layer in enumerate(layers):
                    layer[band.rows][band.on] = band.rgb[:, j]
                advance(len(band.rgb))
        yield Relit(layers, lambda C, light: np.einsum("khwc,k->hwc", C, basis(light).astype(np.float32)))


def matt(normals: Float[np.ndarray, "h w 3"], albedo: Float[np.ndarray, "h w 3"]) -> Relit:
    """As a matt surface would look, without cast shadows and gloss; `albedo` is linear, from 0 to 1."""

    def shown(layers: np.ndarray, light: np.ndarray) -> np.ndarray:
        cos = np.maximum(layers[0] @ light.astype(np.float32), 0)
        return from_linear((layers[1] * cos[..., None]).clip(0, 1))

    return Relit(np.stack([normals, albedo]).astype(np.float32), shown)


def direction(azimuth_deg: float, elevation_deg: float) -> Float[np.ndarray, " 3"]:
    """The unit light at an azimuth from x towards y, and an elevation over the plane of the picture."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
