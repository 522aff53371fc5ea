"""How much is held at a time, by the memory that is allowed (`--memory`); what is found does not depend on it."""

from __future__ import annotations

import torch

from photonormal.files import memory
from photonormal.methods.learned.network import Network
from photonormal.types import Capture, InputError

LEVELS = 2**26  # grey levels held at a time, at most
LEVEL = 64  # bytes allowed for each, with what is made of them
SIDE = {"cpu": 2048, "cuda": 1024}  # of a window in pixels, without its margins, at most
LEAST = 64  # pixels of a window's side, at least
WINDOW = 2 / 3  # of the memory: the rest is for pictures (`capture.store`)
SEEN = 3328  # bytes that a network holds for each pixel that a window sees, in each quarter turn
SAMPLE = 8  # bytes of each sample of such a pixel, where a network is shown all at once


def levels() -> int:
    """Grey levels that may be held at a time."""
    return min(LEVELS, memory.allowed() // LEVEL)


def pixels(capture: Capture) -> int:
    """Pixels of a capture whose grey levels may be held at a time; InputError where they are not one row."""
    n, _, width, _ = capture.images.shape
    _refuse(n * width * LEVEL, f"a row of {width} pixels in {n} photographs")
    return max(width, levels() // n)


def side(net: Network, passes: int, rotations: int, device: torch.device, box: tuple[int, ...], n: int) -> int:
    """Side of a window without its margins, a multiple of the network's stride; InputError where none fits.

    On a processor it is what the memory allows, if a box (h, w) does not fit as a whole; other devices have their own.
    """
    most, margin = SIDE.get(device.type, SIDE["cuda"]), passes * net.reach
    held = (rotations * SEEN + SAMPLE * n * net.pointwise) / WINDOW
    if device.type == "cpu" and held * box[0] * box[1] > memory.allowed():
        least = min((LEAST + 2 * margin) ** 2, box[0] * box[1])
        _refuse(int(held * least), f"a window of {LEAST} pixels with {margin} around it")
        most = min(most, int((memory.allowed() / held) ** 0.5) - 2 * margin)
    return most // net.stride * net.stride


def _refuse(needed: int, what: str) -> None:
    if needed > memory.allowed():
        raise InputError(
            f"{what} needs {memory.text_of(needed)} but {memory.text_of(memory.allowed())} of memory is allowed; allow "
            f"more, such as --memory {memory.text_of(needed, '')}."
        )
