"""glTF 2.0 in one binary file: arrays and pictures after the JSON that tells about them."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
COMPONENTS = {"f": 5126, "u": 5125}  # 32-bit floats and whole numbers
VERTICES, INDICES = 34962, 34963  # what a part of the buffer is for


class Buffer:
    """The binary part of a file, and the lists that tell what lies in it."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.images: list[dict[str, Any]] = []

    def array(self, values: np.ndarray, target: int, bounds: bool = False) -> int:
        """Add (n, 1 to 4) values of 32 bits; returns the number of their accessor."""
        found = {
            "bufferView": self._view(np.ascontiguousarray(values).tobytes(), {"target": target}),
            "componentType": COMPONENTS[values.dtype.kind],
            "count": len(values),
            "type": KINDS[values.shape[1]],
        }
        if bounds:
            found |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        self.accessors.append(found)
        return len(self.accessors) - 1

    def picture(self, png: bytes) -> dict[str, int]:
        """Add a picture as a texture of the same number, as a material names it."""
        self.images.append({"bufferView": self._view(png, {}), "mimeType": "image/png"})
        return {"index": len(self.images) - 1}

    def _view(self, data: bytes, about: dict[str, int]) -> int:
        self.views.append({"buffer": 0, "byteOffset": self.size, "byteLength": len(data), **about})
        data += b"\0" * (-len(data) % 4)
        self.parts.append(data)
        self.size += len(data)
        return len(self.views) - 1

    def file(self, mesh: dict[str, Any], material: dict[str, Any]) -> list[bytes]:
        """The parts of a file whose scene is one mesh of one material."""
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
        return _framed([(b"JSON", [text]), (b"BIN\0", self.parts)])


def _framed(chunks: Sequence[tuple[bytes, Sequence[bytes]]]) -> list[bytes]:
    body: list[bytes] = []
    for kind, parts in chunks:
        body += [struct.pack("<I", sum(map(len, parts))) + kind, *parts]
    return [b"glTF" + struct.pack("<II", 2, 12 + sum(map(len, body))), *body]
