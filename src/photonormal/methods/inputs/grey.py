"""Grey levels of images, and what they decide: shadow, metal, rank. Stated here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.masked import thinned
from photonormal.methods.inputs.blocks import seen_from, some_pixels
from photonormal.shading import LUMA, cosines, over_lights

SHADOW = {0.99: 0.02, 0.75: 0.06}  # quantile of all samples: fraction of it below which a sample may be in shadow
METALLIC = 0.6, 0.4  # of a matt pixel's median over 90 % quantile; share of pixels below it that makes a metal object
READ = 2**20  # samples that suffice to find a quantile
AMONG = 2**24  # samples of the rows that they are taken from: of larger captures not all rows are read


def grey(images: Float[Tensor, "b k c h w"]) -> Float[Tensor, "b k 1 h w"]:
    """Luma of three channels; one channel is grey already."""
    if images.shape[2] == 1:
        return images
    return torch.einsum("bkchw,c->bkhw", images, images.new_tensor(LUMA))[:, :, None]


def grey_samples(samples: Float[np.ndarray, "p c"]) -> Float[np.ndarray, " p"]:
    """The same of samples of one image; what is no number becomes 0."""
    import cv2

    weights = np.asarray(LUMA if samples.shape[1] == 3 else (1.0,), np.float32)
    found = cv2.transform(samples[:, None], weights[None])[:, 0]  # a product with `@` would start threads of its own
    return found if np.isfinite(found).all() else np.nan_to_num(found, nan=0, posinf=0, neginf=0)


def telling(mask: Bool[np.ndarray, "h w"], n: int) -> Bool[np.ndarray, "h w"]:
    """Evenly spaced pixels of a mask, which show the levels of n images: on some rows where a capture is large."""
    lines = np.flatnonzero(mask.any(1))
    step = max(1, min(int(mask.sum()) * n // AMONG, len(lines)))
    found = np.zeros_like(mask)
    found[lines[step // 2 :: step]] = mask[lines[step // 2 :: step]]
    return thinned(found, max(1, int(found.sum()) * n // READ))


@dataclass(frozen=True)
class Levels:
    """What is decided once for a capture, from some of its pixels.

    Parameters
    ----------
    cut : grey level at which highlights end: 1, on which the published classical figures rest, or the 99th percentile
        where that is above 1
    dark : below it a sample is in shadow
    """

    cut: float
    dark: float

    @staticmethod
    def of(I: Float[Tensor, "p n"]) -> Levels:
        """Those of a capture of which these pixels are all, or every so many."""
        cut = max(1.0, float(level(I, 0.99)))
        return Levels(cut, float(darkest(I.clamp(0, cut))))

    def cut_(self, I: Float[Tensor, "p n"]) -> Float[Tensor, "p n"]:
        """The samples without what is beyond; in place."""
        return I.clamp_(0, self.cut)

    def lit(self, I: Float[Tensor, "p n"]) -> Bool[Tensor, "p n"]:
        """Samples not in shadow."""
        return I > self.dark


def level(I: Float[Tensor, "*b p n"], quantile: float) -> Float[Tensor, "*b 1 1"]:
    """A quantile of the samples of each capture: every image of evenly spaced pixels."""
    step = max(1, I.shape[-2] * I.shape[-1] // READ)
    samples = I[..., ::step, :].flatten(-2)  # (*b, m)
    k = max(1, round(quantile * samples.shape[-1]))
    if samples.device.type == "cpu":  # numpy selects ten times faster than torch there
        return torch.from_numpy(np.partition(samples.detach().numpy(), k - 1, axis=-1)[..., k - 1 : k, None])
    return samples.kthvalue(k, dim=-1, keepdim=True).values[..., None]


def lit(I: Float[Tensor, "*b p n"], dark: float | None = None) -> Bool[Tensor, "*b p n"]:
    """Samples not in shadow: brighter than 2 % of the capture's 99th percentile or 6 % of its 75th.

    The second is the lower one on metal, where few samples are very bright and most are dim but lit. `dark`: that
    level, where these are not all samples of a capture.
    """
    return I > (darkest(I) if dark is None else dark)


def darkest(I: Float[Tensor, "*b p n"]) -> Float[Tensor, "*b 1 1"]:
    """The level that `lit` asks for."""
    return torch.minimum(*(fraction * level(I, quantile) for quantile, fraction in SHADOW.items()))


def metallic(I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], L: Float[Tensor, "*l n 3"]) -> bool:
    """Whether light comes off the object in highlights alone: few samples of many pixels outshine the others.

    Told by the median lit sample over the 90 % quantile, against what the least-squares normal's shading has there:
    lights all over the hemisphere spread a matt pixel's samples, too. A highlight on a matt ground changes little.
    """
    some = some_pixels(I.shape[0], 2000)
    I, keep, L = I[some].to(L), keep[some].to(L.device), seen_from(L, some)
    shading = cosines(over_lights(I, torch.linalg.pinv(L).mT), L).clamp(min=0)

    def spread(x: Float[Tensor, "q n"]) -> Float[Tensor, " q"]:
        x = x.masked_fill(~keep, torch.nan)
        return x.nanquantile(0.5, dim=1) / x.nanquantile(0.9, dim=1)

    dark, share = METALLIC
    return bool((spread(I) < dark * spread(shading)).float().mean() > share)


def ascending(I: Float[Tensor, "*p n"]) -> Float[Tensor, "*p n"]:
    """Each pixel's samples from dark to bright."""
    if I.device.type == "cpu":  # numpy sorts with vector instructions: ten times faster than torch there
        return torch.from_numpy(np.sort(I.detach().numpy(), axis=-1))
    return I.sort(dim=-1).values


def ascending_order(x: Float[Tensor, "*p n"] | Int[Tensor, "*p n"]) -> Int[Tensor, "*p n"]:
    """Indices that put each pixel's values in ascending order."""
    if x.device.type == "cpu":
        return torch.from_numpy(np.argsort(x.detach().numpy(), axis=-1))
    return x.argsort(dim=-1)
