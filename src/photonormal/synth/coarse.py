"""What modest cameras and their files make of a picture: few grey levels, JPEG's blocks, a tone curve that is off."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from photonormal.shading import LUMA
from photonormal.synth.params import log_uniform, tensor
from photonormal.synth.recipes import Rendering

LEVELS = 20, 255  # fewest and most grey levels up to the brightest sample of a dark scene
UNEVEN = 3.0  # most ratio of the brightest light's intensity to the darkest one's in a dark scene
QUALITY = 60, 95  # of JPEG
CURVE = 2.2  # power of the tone curve under which JPEG keeps its 8 bits
GAMMA = 0.9, 1.1  # power by which linear values are off
CLIPPED = 0.03, 0.15  # share of the lit samples that a clipped scene has beyond the sensor's range
BLOCK = 8
TABLE = (  # ISO/IEC 10918-1, table K.1: steps of the luminance at quality 50
    (16, 11, 10, 16, 24, 40, 51, 61),
    (12, 12, 14, 19, 26, 58, 60, 55),
    (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62),
    (18, 22, 37, 56, 68, 109, 103, 77),
    (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101),
    (72, 92, 95, 98, 112, 100, 103, 99),
)
Pictures = Float[Tensor, "c n 3 h w"]


@dataclass(frozen=True)
class Coarsening:
    """What happens to the pictures of `b` scenes.

    Parameters
    ----------
    levels : (b,) grey levels up to full scale; 0: as the sensor has them
    black : (b,) what is added before rounding, in levels: -0.5 cuts off, 0 rounds
    gain : (b, n) intensity of each light while the picture is taken, over that of the brightest
    quality : (b,) of JPEG; 0: none
    gamma : (b,) power by which linear values are off
    clipped : (b,) share of the lit samples beyond the sensor's range
    """

    levels: np.ndarray
    black: np.ndarray
    gain: np.ndarray
    quality: np.ndarray
    gamma: np.ndarray
    clipped: np.ndarray

    @staticmethod
    def none(b: int, n: int) -> Coarsening:
        """A good camera's."""
        zero, one = np.zeros(b), np.ones(b)
        return Coarsening(zero, zero, np.ones((b, n)), zero, one, zero)

    @staticmethod
    def drawn(recipe: Rendering, g: np.random.Generator, b: int, n: int) -> Coarsening:
        """At random, in the shares of a recipe that has any; each fault comes and goes by itself."""
        if not recipe.dark + recipe.jpeg + recipe.gamma + recipe.clipped:
            return Coarsening.none(b, n)
        dark, jpeg, bent, clipped = (g.random(b) < s for s in (recipe.dark, recipe.jpeg, recipe.gamma, recipe.clipped))
        gain = log_uniform(g, 1 / UNEVEN, 1, (b, n)) ** g.random((b, 1))  # some sets are even
        return Coarsening(
            np.where(dark, log_uniform(g, *LEVELS, b).round(), 0),
            np.where(dark, np.where(g.random(b) < 0.5, -0.5, g.uniform(-0.5, 0.5, b)), 0),
            np.where(dark[:, None], gain / gain.max(1, keepdims=True), 1),
            np.where(jpeg, g.integers(QUALITY[0], QUALITY[1] + 1, b), 0),
            np.where(bent, g.uniform(*GAMMA, b), 1),
            np.where(clipped, g.uniform(*CLIPPED, b), 0),
        )

    def windows(self, crops: int) -> Coarsening:
        """The same for each of the `crops` windows of a scene."""
        return Coarsening(*(np.repeat(getattr(self, f.name), crops, 0) for f in fields(self)))


def stored(I: Pictures, coarse: Coarsening, g: np.random.Generator) -> Pictures:
    """Windows (linear, within [0, 1]) as a file gives them back: after JPEG, read by a tone curve that is off."""
    some = np.flatnonzero(coarse.quality)
    if len(some):
        I = I.clone()
        I[some] = jpeg(I[some], tensor(coarse.quality[some]).to(I.device), g.integers(0, BLOCK, 2).tolist())
    some = np.flatnonzero(coarse.gamma != 1)
    if len(some):
        I = I.clone()
        I[some] = I[some] ** tensor(coarse.gamma[some]).view(-1, 1, 1, 1, 1).to(I.device)
    return I


def jpeg(I: Pictures, quality: Float[Tensor, " c"], corner: tuple[int, int] | list[int] = (0, 0)) -> Pictures:
    """What JPEG keeps of linear values within [0, 1]; `corner` is the pixel (column, row) of its first block's start.

    Only the luminance loses detail: what colours lose on top of that is not seen in grey levels.
    """
    v = 255 * I.clamp(0, 1) ** (1 / CURVE)
    Y = torch.einsum("cnkhw,k->cnhw", v, v.new_tensor(LUMA))
    h, w = Y.shape[-2:]
    left, top = ((BLOCK - x) % BLOCK for x in corner)
    padded = F.pad(Y, (left, -(w + left) % BLOCK, top, -(h + top) % BLOCK), mode="replicate")
    blocks = padded.unflatten(-1, (-1, BLOCK)).unflatten(-3, (-1, BLOCK)).transpose(-3, -2)  # (c, n, i, j, 8, 8)
    D = dct_matrix().to(I)
    scale = torch.where(quality < 50, 5000 / quality, 200 - 2 * quality).view(-1, 1, 1, 1, 1, 1)
    steps = ((I.new_tensor(TABLE) * scale + 50) / 100).floor().clamp(1, 255)
    kept = D.T @ ((D @ blocks @ D.T / steps).round() * steps) @ D
    kept = kept.transpose(-3, -2).flatten(-2).flatten(-3, -2)[..., top : top + h, left : left + w]
    return ((v + (kept - Y)[:, :, None]).round().clamp(0, 255) / 255) ** CURVE


def dct_matrix() -> Float[Tensor, "8 8"]:
    """The orthonormal cosine transform of 8 samples: rows are frequencies."""
    k, x = torch.arange(BLOCK)[:, None], torch.arange(BLOCK)
    D = torch.cos(math.pi * k * (2 * x + 1) / (2 * BLOCK)) * math.sqrt(2 / BLOCK)
    D[0] /= math.sqrt(2)
    return D
