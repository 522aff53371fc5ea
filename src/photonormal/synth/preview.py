"""Contact sheets of rendered samples, for a person to judge."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from photonormal.synth.stream import RenderedBatch

COLUMNS = 3  # samples in a row
PICTURES = 3  # of a sample's images, at most
GAP = 2  # pixels between samples
WIDTH = 76  # pixels of a picture on the sheet at most


def contact_sheet(batches: list[RenderedBatch]) -> UInt8[np.ndarray, "h w 3"]:
    """For each sample its normals and some of its images, brightened to be looked at."""
    tiles = [tile for batch in batches for tile in _tiles(batch)]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[i : i + COLUMNS], 1) for i in range(0, len(tiles), COLUMNS)]
    return (np.concatenate(rows) * 255).round().astype(np.uint8)


def _tiles(batch: RenderedBatch) -> list[Float[np.ndarray, "h w 3"]]:
    import cv2

    tiles = []
    for I, N, mask in zip(batch.images, batch.normals, batch.mask, strict=True):
        chosen = np.linspace(0, len(I) - 1, min(PICTURES, len(I))).round().astype(int)
        bright = np.quantile(I.amax(1)[:, mask[0]].cpu().numpy(), 0.97)
        images = [np.clip(I[j].cpu().numpy() / max(bright, 1e-6), 0, 1) ** (1 / 2.2) for j in chosen]
        shown = [((N * 0.5 + 0.5) * mask).cpu().numpy(), *images]
        size = min(WIDTH, I.shape[-1])
        small = [cv2.resize(image.transpose(1, 2, 0), (size, size), interpolation=cv2.INTER_AREA) for image in shown]
        tiles.append(np.pad(np.concatenate(small, 1), ((0, GAP), (0, GAP), (0, 0))))
    return tiles
