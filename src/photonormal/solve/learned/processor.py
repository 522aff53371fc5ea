"""What a machine does best, measured once per process: number format of the inner layers, memory kept for reuse."""

from __future__ import annotations

import ctypes
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from functools import cache

import torch
from torch import nn

GAIN = 1.5  # bf16 is used where it is at least so much faster than float32


@cache
def bf16_pays(device_type: str) -> bool:
    """Whether convolutions in bf16 are faster than in float32: on GPUs that know it, on processors with AMX."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported()
    if device_type != "cpu" or not torch.backends.mkldnn.is_available():
        return False
    layer = nn.Conv2d(64, 64, 3, padding=1).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    x = torch.zeros(1, 64, 64, 64).contiguous(memory_format=torch.channels_last)  # about 5 ms in float32
    seconds = {}
    with torch.inference_mode():
        for dtype in (torch.float32, torch.bfloat16):
            net, y = layer.to(dtype), x.to(dtype)
            net(y)
            seconds[dtype] = min(_seconds(net, y) for _ in range(3))
    return seconds[torch.float32] > GAIN * seconds[torch.bfloat16]


def _seconds(net: nn.Module, x: torch.Tensor) -> float:
    start = time.perf_counter()
    net(x)
    return time.perf_counter() - start


def inner_precision(device: torch.device) -> AbstractContextManager:
    """Autocast to bf16 where that pays, else nothing."""
    return torch.autocast(device.type, torch.bfloat16) if bf16_pays(device.type) else nullcontext()


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
