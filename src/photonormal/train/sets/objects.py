"""Folders of objects in DiLiGenT's layout with true normals: `photonormal.capture.diligent`."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from photonormal.capture import diligent
from photonormal.capture.assemble import Choice
from photonormal.train.sets import SampleSet, Shape
from photonormal.types import Capture, InputError


class ObjectSet(SampleSet):
    """Objects by the names of their folders; all are learned from."""

    layout: ClassVar[str] = "diligent"
    alike: ClassVar[bool] = False

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        found = [root] if diligent.is_object(root) else diligent.objects(root)
        self.folders = {folder.resolve().name: folder for folder in found}
        self.training = tuple(self.folders)

    @classmethod
    def matches(cls, root: Path) -> bool:
        return diligent.matches(root)

    def shape(self, key: str) -> Shape:
        capture = self.read(key)
        n, h, w, _ = capture.images.shape
        return Shape(n, h, w)

    def read(self, key: str) -> Capture:
        folder = self.folders[key]
        capture = diligent.read(folder, Choice())
        if capture.truth is None:
            raise InputError(
                f"{folder} has no Normal_gt.mat but true normals are learned from; add it or leave it out."
            )
        return capture
