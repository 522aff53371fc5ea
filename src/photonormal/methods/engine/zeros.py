"""Samples of dark pictures: what their channels say of each other, and what a pixel's samples say of its zeros.

A pixel has one hue, so the channels of a sample show one grey level, each to within a level of its own: what all allow
is less than what each does. Samples that are zero in every channel are mostly no shadows, but less light than a level.
Each pixel gets a matt shading b.l, fitted to its samples; a zero is known to lie between 0 and a level, so its value is
the shading's, cut to that (a censored regression, by expectation and maximisation). Where the shading says much more
than a level, a zero is a shadow. Pixels most of whose samples are zero show too little, and keep them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Lock

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.masked import box_of, picked
from photonormal.methods.classical.woodham import pairs, symmetric_inverse, symmetric_product
from photonormal.methods.engine import plan
from photonormal.shading import LUMA
from photonormal.types import Capture, Image, window_of

SAMPLES = 2**18  # fitted together, at most
ROUNDS = 6  # of the fit
ENOUGH = 0.4, 0.7  # share of a pixel's samples that are not zero, from which on its zeros are filled, and all the way
LIT, SHADOW = 0.95, 0.1  # share of zeros that no shadow makes, where less than a level is expected; levels in a shadow
OFF = 0.25, 0.1  # by which a sample may differ from its shading: of a level, and of the shading
NOISE = 0.29  # deviation of what whole levels leave out, 1 / sqrt(12) of a level
FAR = 3.0  # deviations from which on a sample, such as a highlight, counts little
HUES, FAINTEST = 5, 0.02  # rounds in which the hue of a pixel is found; least of a channel in it


@dataclass
class Filled:
    """Pictures whose samples on the mask are what their channels and pixels say (`photonormal.types.Images`).

    Rows are fitted when they are first asked for; what is kept of them are 14 bytes a pixel.

    Parameters
    ----------
    capture : the pictures with zeros
    size : (n, c) radiance of a level in each image, below which a sample became zero
    """

    capture: Capture
    size: Float[np.ndarray, "n c"]
    known: dict[int, Float[np.ndarray, "h w d"]] = field(default_factory=dict, repr=False)  # of blocks of rows
    opening: Lock = field(default_factory=Lock, repr=False)

    def __post_init__(self) -> None:
        n, _, _, c = self.shape = self.capture.images.shape
        self.columns = box_of(self.capture.mask)[1]
        wide = self.columns.stop - self.columns.start
        self.rows = max(1, min(SAMPLES, plan.levels(self.capture)) // (n * c * wide))  # of a block

    def __getitem__(self, j: int, /) -> Image:
        return self.window(j, slice(None), slice(None))

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of one picture."""
        if (rows.step or 1) > 1:
            return self.window(j, slice(rows.start, rows.stop), columns)[:: rows.step]
        image = window_of(self.capture.images, j, rows, columns).copy()
        (top, bottom, _), (left, right, _) = (
            s.indices(side) for s, side in zip((rows, columns), self.shape[1:3], strict=True)
        )
        first, last = max(left, self.columns.start), min(right, self.columns.stop)
        for block in range(top // self.rows, -(-bottom // self.rows)) if first < last else ():
            start = block * self.rows
            a, b = max(top, start), min(bottom, start + self.rows)
            part = image[a - top : b - top, first - left : last - left]
            inside = self.capture.mask[a:b, first:last]
            if inside.any():
                map = self.block(block)[a - start : b - start, first - self.columns.start : last - self.columns.start]
                lit = (part > 0).any(-1)
                dark, lit = inside & ~lit, inside & lit
                part[dark] = self.expected(map[dark], j)
                part[lit] = self.agreed(part[lit], map[lit], j)
        return image

    def agreed(self, I: Float[np.ndarray, "p c"], map: Float[np.ndarray, "p d"], j: int) -> Float[np.ndarray, "p c"]:
        """What samples of image `j` were, by all their channels and the hue of their pixels."""
        size, hue = torch.from_numpy(self.size[j]), torch.from_numpy(map[:, 4:].astype(np.float32))
        return (crossed(torch.from_numpy(I) / size, hue / size) * size).numpy()

    def expected(self, map: Float[np.ndarray, "p d"], j: int) -> Float[np.ndarray, "p c"]:
        """What zeros of image `j` were, by what is known of their pixels."""
        known = map.astype(np.float32)
        share, b, hue = known[:, :1], known[:, 1:4], known[:, 4:]
        S = (b @ self.capture.known_lights()[j].astype(np.float32))[:, None]
        P = torch.from_numpy(hue * S * (self.size.mean() / self.size[j]))
        X, _ = expectation(P)
        return share * X.numpy() * self.size[j]

    def block(self, number: int) -> Float[np.ndarray, "h w d"]:
        """Share to fill, shading in mean levels (3) and hue (c) of the pixels of some rows; half precision."""
        with self.opening:
            if number not in self.known:
                self.known[number] = self.fitted(slice(number * self.rows, (number + 1) * self.rows))
            return self.known[number]

    def fitted(self, rows: slice) -> Float[np.ndarray, "h w d"]:
        """The same, fitted."""
        mask = self.capture.mask[rows, self.columns]
        n, _, _, c = self.shape
        I = np.empty((int(mask.sum()), n, c), np.float32)
        for j in range(n):  # by this thread alone: others wait for it
            I[:, j] = picked(self.capture.window(j, rows, self.columns), mask)
        found = np.zeros((*mask.shape, 4 + c), np.float16)
        found[mask] = shading(torch.from_numpy(I), self.size, self.capture.known_lights()).numpy()
        return found


def shading(
    I: Float[Tensor, "p n c"], size: Float[np.ndarray, "n c"], L: Float[np.ndarray, "n 3"]
) -> Float[Tensor, "p d"]:
    """Of each pixel the share of its zeros to fill, its shading b (3), in mean levels, and its hue (c)."""
    level, lights = torch.from_numpy(size), torch.from_numpy(L).float()
    luma = torch.tensor(LUMA if size.shape[1] == 3 else (1.0,))
    unit = level.mean()
    grey = level @ luma  # (n,)
    zero = I <= 0
    black = zero.all(2)
    hue = hues(I, level, luma)  # (p, c)
    noise = NOISE * (level * luma).norm(dim=1) / grey  # (n,) in grey levels
    at = pixel, image, channel = zero.nonzero(as_tuple=True)
    step = level[image, channel]  # of each zero
    X, weight = I.index_put(at, 0.4 * step), torch.ones_like(black, dtype=I.dtype)
    b = I.new_zeros(len(I), 3)
    for _ in range(ROUNDS):
        b = fitted(weight, X @ luma, lights)
        S = b @ lights.T  # (p, n)
        expected, lit = expectation(hue[pixel, channel] * S[pixel, image] / step)
        X.index_put_(at, expected * step)
        variance = noise**2 + 0.02 + (0.05 * S / grey).clamp(min=0) ** 2
        off = (X @ luma - S) / grey
        weight = 1 / (variance + (off / FAR) ** 2)
        certain = torch.zeros_like(S).index_put_((pixel, image), lit / len(luma), accumulate=True)
        weight *= torch.where(black, torch.where(S > 0, certain, 1e-3), 1)
    low, high = ENOUGH
    share = (((~zero).float().mean((1, 2)) - low) / (high - low)).clamp(0, 1)
    return torch.cat([share[:, None], b / unit, hue], dim=1)


def hues(I: Float[Tensor, "p n c"], level: Float[Tensor, "n c"], luma: Float[Tensor, " c"]) -> Float[Tensor, "p c"]:
    """Colour of each pixel, of grey level 1, by its samples that are not zero in all channels."""

    def of(X: Float[Tensor, "p n c"]) -> Float[Tensor, "p c"]:
        total = X.sum(1)
        return (total / (total @ luma)[:, None].clamp(min=1e-9)).clamp(min=FAINTEST)

    counts, shown, hue = I / level, (I > 0).any(2, keepdim=True), of(I)
    for _ in range(HUES - 1):
        hue = of(shown * crossed(counts, hue[:, None] / level) * level)
    return hue


def crossed(counts: Float[Tensor, "*p c"], hue: Float[Tensor, "*p c"]) -> Float[Tensor, "*p c"]:
    """Samples in levels, of the grey level amid those that all channels allow; each stays within its own level.

    `hue`: levels of each channel for a grey level of 1.
    """
    least = (counts - 0.5).clamp(min=0)
    grey = ((least / hue).amax(-1, keepdim=True) + ((least + 1) / hue).amin(-1, keepdim=True)) / 2
    return (hue * grey).clamp(least, least + 1)


def expectation(P: Float[Tensor, "*p"]) -> tuple[Float[Tensor, "*p"], Float[Tensor, "*p"]]:
    """Expected value of zeros whose shading is `P`, in levels, and the probability that they are no shadows."""
    off = (OFF[0] ** 2 + (OFF[1] * P) ** 2).sqrt()
    likely = LIT * torch.special.ndtr((1 - P) / off)
    lit = torch.where(P > 0, likely / (likely + 1 - LIT), 1)
    return P.clamp(0, 1) * lit + (1 - lit) * SHADOW, lit


def fitted(w: Float[Tensor, "p n"], y: Float[Tensor, "p n"], L: Float[Tensor, "n 3"]) -> Float[Tensor, "p 3"]:
    """Weighted least squares, a little short where the lights show little."""
    A = w @ pairs(L) + 1e-4 * w.mean(1, keepdim=True) * w.new_tensor([1, 0, 0, 1, 0, 1])
    return symmetric_product(symmetric_inverse(A)[0], (w * y) @ L)
