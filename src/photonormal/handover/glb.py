"""glTF 2.0 in one binary file: arrays and pictures after the JSON that describes them."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from photonormal.types import InputError

KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
COMPONENTS = {"f": 5126, "u": 5125}  # 32-bit floats and whole numbers
VERTICES, INDICES = 34962, 34963  # what a part of the buffer is for
LARGEST = 2**32 - 1  # bytes of a file
PIECE = 2**22  # bytes of a picture copied at a time


class Buffer:
    """The binary part of a file, and the lists that show what lies in it; pictures lie in files of their own."""

    def __init__(self) -> None:
        self.parts: list[bytes | BinaryIO] = []
        self.size = 0
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.images: list[dict[str, Any]] = []

    def array(self, values: np.ndarray, target: int, bounds: bool = False) -> int:
        """Add (n, 1 to 4) values of 32 bits; returns the number of their accessor."""
        data = np.ascontiguousarray(values).tobytes()
        found = {
            "bufferView": self._view(data, len(data), {"target": target}),
            "componentType": COMPONENTS[values.dtype.kind],
            "count": len(values),
            "type": KINDS[values.shape[1]],
        }
        if bounds:
            found |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.accessors.append(found)
        return len(self.accessors) - 1

    def picture(self, png: BinaryIO) -> dict[str, int]:
        """Add a picture, an open file, as a texture of the same number, as a material names it."""
        self.images.append({"bufferView": self._view(png, png.seek(0, 2), {}), "mimeType": "image/png"})
        return {"index": len(self.images) - 1}

    def _view(self, data: bytes | BinaryIO, size: int, about: dict[str, int]) -> int:
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": size, **about})
        padding = b"\0" * (-size % 4)
        self.parts += [data, padding]
        self.size += size + len(padding)
        return len(self.views) - 1

    def file(self, mesh: dict[str, Any], material: dict[str, Any]) -> Iterator[bytes]:
        """The pieces of a file whose scene is one mesh of one material.

        Raises
        ------
        InputError
            If it would be larger than the format can hold.
        """
        content = {
            "asset": {"version": "2.0", "generator": "photonormal"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [mesh | {"material": 0}]}],
            "materials": [material],
            "textures": [{"sampler": 0, "source": k} for k in range(len(self.images))],
            "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
            "images": self.images,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.size}],
        }
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        size = 28 + len(text) + self.size
        if size > LARGEST:
            raise InputError(
                f"the .glb file would have {size} bytes but the format ends at {LARGEST}; choose a smaller --texture."
            )
        yield b"glTF" + struct.pack("<II", 2, size)
        yield struct.pack("<I", len(text)) + b"JSON" + text
        yield struct.pack("<I", self.size) + b"BIN\0"
        for part in self.parts:
            if isinstance(part, bytes):
                yield part
            else:
                part.seek(0)
                while piece := part.read(PIECE):
                    yield piece
