"""What every solver starts from: grey levels on the mask, light directions, and the tests of a usable sample.

Grey-level conversion, the shadow threshold and normalisation live here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import LUMA
from photonormal.types import Capture, InputError, Normals

BLOCK = 2**22  # samples solved at a time: bounds the memory of every method


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
    """Grey level of each mask pixel in each image, float32 on the processor.

    Luma of the three channels, clipped to [0, 1] unless `clip` is False (the published classical figures rest on the
    clip; learned methods read highlights above 1).
    """
    weights = np.asarray(LUMA if capture.images.shape[3] == 3 else (1.0,), np.float32)

    def grey(_: int, image: np.ndarray) -> Tensor:
        level = image[capture.mask] @ weights  # (p,)
        return torch.from_numpy(level.clip(0, 1) if clip else level)

    return torch.stack(capture.map_images(grey), dim=-1)


def lit(I: Float[Tensor, "*p n"], fraction: float = 0.02) -> Bool[Tensor, "*p n"]:
    """Samples brighter than `fraction` of the 99th percentile of all of them: not in shadow."""
    flat = I.reshape(-1)
    step = max(1, flat.numel() // 2**20)  # torch.quantile takes at most 16 million values
    return I > fraction * torch.quantile(flat[::step].float(), 0.99)


def normalised(b: Float[Tensor, "*p 3"]) -> Float[Tensor, "*p 3"]:
    """Unit vectors along `b`; zero where `b` is zero or not finite."""
    length = b.norm(dim=-1, keepdim=True)
    return torch.where(torch.isfinite(length) & (length > 0), b / length, torch.zeros_like(b))


def per_pixel(
    normals: Callable[[Tensor, Tensor], Tensor], capture: Capture, device: torch.device, dtype: torch.dtype
) -> Normals:
    """Solve a capture by a method that treats each pixel alone.

    `normals` maps grey levels (p, n) and lights (n, 3) to unit normals (p, 3), zero where there is none. Blocks of
    pixels bound the memory.
    """
    I = grey_levels(capture)  # (p, n)
    L = torch.as_tensor(capture.known_lights(), dtype=dtype, device=device)
    blocks = I.split(max(1, BLOCK // I.shape[1]))
    N = torch.cat([normals(block.to(device, dtype), L).to("cpu", torch.float32) for block in blocks])
    return on_mask(N, capture)


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
