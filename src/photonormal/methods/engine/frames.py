"""Images one after the other, the next ones read while one is looked at."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor

from photonormal.methods.engine.windows import Box, Span
from photonormal.types import Capture

AHEAD = 2  # images read while one is looked at


def frames(
    capture: Capture, box: Box, seen: Span, device: torch.device, together: int = 1
) -> Iterator[tuple[int, Tensor]]:
    """(j, images j, j + 1, ... (1, k, c, h, w)) of a part of the box, up to `together` at a time."""
    n = capture.images.shape[0]
    held: list[Tensor] = []
    for j, image in enumerate(_ahead(capture, box, seen)):
        held.append(image)
        if len(held) == together or j == n - 1:
            found = held[0] if len(held) == 1 else torch.cat(held, dim=1)
            held = []
            yield j + 1 - found.shape[1], found.to(device)
            del image, found  # before the next is read


def _ahead(capture: Capture, box: Box, seen: Span) -> Iterator[Tensor]:
    n = capture.images.shape[0]
    with ThreadPoolExecutor(1) as reader:
        waiting = [reader.submit(box.read, capture, j, seen) for j in range(min(AHEAD, n))]
        for j in range(n):
            image = waiting.pop(0).result()
            if j + AHEAD < n:
                waiting.append(reader.submit(box.read, capture, j + AHEAD, seen))
            yield image
