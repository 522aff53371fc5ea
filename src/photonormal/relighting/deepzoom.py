"""Deep Zoom: a picture as a pyramid of tiles, of which viewers load what they show."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from photonormal.disk import FileBatch

SIDE, OVERLAP = 510, 1  # pixels of a tile, and those of its neighbours around it


def write(
    picture: np.ndarray, name: str, folder: FileBatch, ending: str, encode: Callable[[np.ndarray], bytes]
) -> None:
    """Write NAME.dzi, and NAME_files/LEVEL/X_Y.ENDING down to the level of one pixel.

    Parameters
    ----------
    picture : (h, w, 3)
    encode : gives the bytes of a tile
    """
    import cv2

    h, w = picture.shape[:2]
    for level in range(max(h - 1, w - 1).bit_length(), -1, -1):
        rows, columns = picture.shape[:2]
        for y in range(0, rows, SIDE):
            for x in range(0, columns, SIDE):
                tile = picture[max(y - OVERLAP, 0) : y + SIDE + OVERLAP, max(x - OVERLAP, 0) : x + SIDE + OVERLAP]
                folder.write(f"{name}_files/{level}/{x // SIDE}_{y // SIDE}.{ending}", encode(tile))
        half = (-(-columns // 2), -(-rows // 2))
        picture = cv2.resize(picture, half, interpolation=cv2.INTER_AREA)
    dzi = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<Image xmlns="http://schemas.microsoft.com/deepzoom/2008" '
        f'Format="{ending}" Overlap="{OVERLAP}" TileSize="{SIDE}">\n  <Size Width="{w}" Height="{h}"/>\n</Image>\n'
    )
    folder.write(f"{name}.dzi", dzi.encode())
