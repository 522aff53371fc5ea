"""Where the engine computes."""

from __future__ import annotations

import torch

from photonormal.types import InputError


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
