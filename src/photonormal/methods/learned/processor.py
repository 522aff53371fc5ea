"""What a machine does best: number format of the inner layers, by its instructions, and memory kept for reuse."""

from __future__ import annotations

import ctypes
import platform
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.options import Precision, check_value

PICTURES = 16  # from which on torch asks oneDNN for convolutions of 1 x 1, also with one thread

_asked: ContextVar[Precision] = ContextVar("precision", default="auto")


@contextmanager
def computing_in(asked: Precision) -> Iterator[None]:
    """Networks compute in `asked` inside the block; "auto": in bf16 where the machine has instructions for it."""
    check_value(asked, Precision, "precision")
    before = _asked.set(asked)
    try:
        yield
    finally:
        _asked.reset(before)


def number_format(device: torch.device, exact: bool = False) -> Literal["float32", "bf16"]:
    """What a network computes in on a device: the same in every process on the same machine, however busy it is.

    `exact`: see `photonormal.methods.learned.network.Model`.
    """
    asked = _asked.get()
    if asked == "auto":
        return "bf16" if knows_bf16(device.type) and not (exact and device.type == "cpu") else "float32"
    return asked


def inner_precision(device: torch.device, exact: bool = False) -> AbstractContextManager:
    """Autocast to bf16 where that is the number format, else nothing."""
    return torch.autocast(device.type, torch.bfloat16) if number_format(device, exact) == "bf16" else nullcontext()


def exactly(device: torch.device) -> AbstractContextManager:
    """No autocast, within `inner_precision` or not."""
    return torch.autocast(device.type, enabled=False)


def of_rows(layer: nn.Linear, x: Float[Tensor, "*q i"]) -> Float[Tensor, "*q o"]:
    """What a layer makes of many rows.

    Torch takes float32 products from MKL, which is half as fast on AMD's processors as on Intel's. oneDNN is as fast on
    both, and takes them as convolutions of 1 x 1 on several pictures.
    """
    some, rounded = x.shape[:-1], x.dtype != torch.float32 or torch.is_autocast_enabled("cpu")
    if x.device.type != "cpu" or rounded or some.numel() % PICTURES:
        return layer(x)
    pictures = x.reshape(PICTURES, 1, -1, x.shape[-1]).permute(0, 3, 1, 2)
    return F.conv2d(pictures, layer.weight[:, :, None, None], layer.bias).permute(0, 2, 3, 1).reshape(*some, -1)


def knows_bf16(device_type: str) -> bool:
    """Whether a GPU, or a processor (AVX-512 BF16 or AMX of x86, BF16 of ARM), multiplies bf16 by own instructions."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device_type != "cpu" or not torch.backends.mkldnn.is_available():
        return False
    if platform.machine().lower() in ("aarch64", "arm64"):
        return torch.ops.mkldnn._is_mkldnn_bf16_supported()
    known = (getattr(torch.cpu, f"_is_{name}_supported", None) for name in ("avx512_bf16", "amx_tile"))
    return any(ask() for ask in known if ask is not None)  # a torch that can't say: float32


def keep_freed_memory() -> None:
    """Let the C library keep memory that was freed instead of returning it to the system (Linux with glibc only).

    A training step frees and takes the same large tensors again; zeroing fresh pages costs several times what is done
    with them (copying 33 MB: 94 ms against 16 ms).
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        libc = ctypes.CDLL("libc.so.6")
        libc.mallopt(-3, 2**30)  # M_MMAP_THRESHOLD
        libc.mallopt(-1, 2**31 - 1)  # M_TRIM_THRESHOLD
    except (OSError, AttributeError):  # another C library
        return
