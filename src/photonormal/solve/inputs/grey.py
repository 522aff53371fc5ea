"""What every solver starts from: grey levels on the mask, light directions, and the tests of a usable sample.

Grey-level conversion, the shadow threshold and normalisation live here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.shading import LUMA, cosines, over_lights
from photonormal.types import Capture, InputError, Normals

BLOCK = {"cpu": 2**18, "cuda": 2**22}  # samples solved at a time: bounds memory; on the processor they fit its cache
SHADOW = {0.99: 0.02, 0.75: 0.06}  # quantile of all samples: fraction of it below which a sample may be in shadow
METALLIC = 0.6, 0.4  # of a matt pixel's median over 90 % quantile; share of pixels below it that makes a metal object
READ = 2**20  # samples that suffice to find a quantile


def torch_device(name: str) -> torch.device:
    """The device called `name`; "auto" is the first GPU, or the processor where there is none."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
    except RuntimeError:
        raise InputError(f"no device {name!r}; use auto, cpu or cuda.") from None
    if device.type == "cuda" and not torch.cuda.is_available():
        raise InputError("device cuda was asked for but torch sees no GPU here; use --device cpu.")
    return device


def grey_levels(capture: Capture, clip: bool = True) -> Float[Tensor, "p n"]:
    """Grey level of each mask pixel in each image, float32 on the processor; samples that are no number become 0.

    Luma of the three channels. Unless `clip` is False it is clipped to [0, 1], or to the 99th percentile where
    that is above 1: the published classical figures rest on the clip; learned methods read highlights above 1.
    """
    weights = np.asarray(LUMA if capture.images.shape[3] == 3 else (1.0,), np.float32)
    inside = np.flatnonzero(capture.mask)

    def grey(_: int, image: np.ndarray) -> np.ndarray:
        level = image.reshape(-1, image.shape[2]).take(inside, axis=0) @ weights  # (p,)
        return level if np.isfinite(level).all() else np.nan_to_num(level, nan=0, posinf=0, neginf=0)

    I = torch.from_numpy(np.stack(capture.map_images(grey), axis=-1))  # (p, n)
    return I.clamp_(0, max(1.0, float(level(I, 0.99)))) if clip else I


def level(I: Float[Tensor, "*b p n"], quantile: float) -> Float[Tensor, "*b 1 1"]:
    """A quantile of the samples of each capture: every image of evenly spaced pixels."""
    step = max(1, I.shape[-2] * I.shape[-1] // READ)
    samples = I[..., ::step, :].flatten(-2)  # (*b, m)
    k = max(1, round(quantile * samples.shape[-1]))
    if samples.device.type == "cpu":  # numpy selects ten times faster than torch there
        return torch.from_numpy(np.partition(samples.detach().numpy(), k - 1, axis=-1)[..., k - 1 : k, None])
    return samples.kthvalue(k, dim=-1, keepdim=True).values[..., None]


def lit(I: Float[Tensor, "*b p n"]) -> Bool[Tensor, "*b p n"]:
    """Samples not in shadow: brighter than 2 % of the capture's 99th percentile or 6 % of its 75th.

    The second is the lower one on metal, where few samples are very bright and most are dim but lit.
    """
    dark = [fraction * level(I, quantile) for quantile, fraction in SHADOW.items()]
    return I > torch.minimum(*dark)


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


def normalised(b: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """Unit vectors along `b`; zero where `b` is zero or not finite."""
    length = b.norm(dim=-1, keepdim=True)
    return torch.where(torch.isfinite(length) & (length > 0), b / length, torch.zeros_like(b))


def at_least(n: int, capture: Capture, method: str) -> None:
    """Raise InputError where a method needs more lights than the capture has."""
    if capture.images.shape[0] < n:
        raise InputError(
            f"{capture.images.shape[0]} images came but {method} needs {n} or more lights; "
            "add photographs or use woodham."
        )


def blocks(p: int, n: int, device: torch.device) -> Iterator[slice]:
    """Slices of `p` pixels under `n` lights, each of a size that suits the device."""
    step = max(1, BLOCK[device.type if device.type in BLOCK else "cpu"] // n)
    return (slice(start, start + step) for start in range(0, p, step))


def per_pixel(
    normals: Callable[[Tensor, Tensor], Tensor], capture: Capture, device: torch.device, dtype: torch.dtype
) -> Normals:
    """Solve a capture by a method that treats each pixel alone.

    `normals` maps grey levels (p, n) and lights (`photonormal.shading`) to unit normals (p, 3), zero where there is
    none. Blocks of pixels bound the memory.
    """
    return per_lit_pixel(lambda I, _, L: normals(I, L), capture, device, dtype)


def per_lit_pixel(
    fit: Callable[[Tensor, Tensor, Tensor], Tensor],
    capture: Capture,
    device: torch.device,
    dtype: torch.dtype,
    metal: Callable[[Tensor, Tensor, Tensor], Tensor] | None = None,
) -> Normals:
    """As `per_pixel`, for a `fit` that also takes which samples are lit (p, n), by the whole capture's threshold.

    An object that is `metallic` is solved by `metal`, where it is given.
    """
    I = grey_levels(capture)  # (p, n)
    keep = lit(I)
    L = lights_of(capture, device, dtype)
    chosen = metal if metal is not None and metallic(I, keep, L) else fit
    return on_mask(every_pixel(chosen, I, keep, L).to("cpu", torch.float32), capture)


def every_pixel(
    fit: Callable[[Tensor, Tensor, Tensor], Tensor],
    I: Float[Tensor, "p n"],
    keep: Bool[Tensor, "p n"],
    L: Float[Tensor, "*l n 3"],
) -> Float[Tensor, "p 3"]:
    """``fit(I, keep, L)`` block by block, in the precision and on the device of the lights."""
    found = [fit(I[s].to(L), keep[s].to(L.device), seen_from(L, s)) for s in blocks(I.shape[0], I.shape[1], L.device)]
    return torch.cat(found)


def lights_of(capture: Capture, device: torch.device, dtype: torch.dtype = torch.float32) -> Float[Tensor, "*l n 3"]:
    """Light directions: (n, 3), or (p, n, 3) where each of the mask's pixels sees them elsewhere."""
    lights = capture.known_lights() if capture.lights_at is None else capture.lights_at
    return torch.as_tensor(lights, dtype=dtype, device=device)


def seen_from(L: Float[Tensor, "*l n 3"], some: slice | Tensor) -> Float[Tensor, "*q n 3"]:
    """The lights of some pixels: their own, or those that all share."""
    return L if L.ndim == 2 else L[some]


def some_pixels(p: int, count: int) -> Int[Tensor, " q"]:
    """At most `count` of `p` pixels, at random, the same ones each time."""
    return torch.randperm(p, generator=torch.Generator().manual_seed(0))[:count].sort().values


def on_mask(N: Float[Tensor, "p 3"], capture: Capture) -> Normals:
    """Normals of the mask's pixels as a map; pixels whose normal is zero are left out of its mask."""
    found = N.norm(dim=-1).numpy() > 0.5
    if not found.any():
        raise InputError(f"all pixels of {capture.name} inside the mask are dark; check exposure, mask and images.")
    mask = capture.mask.copy()
    mask[capture.mask] = found
    values = np.zeros((*capture.mask.shape, 3), np.float32)
    values[capture.mask] = N.numpy()
    return Normals(values, mask)
