"""What the learned methods share: options of a measurement, and the weights that come with the package."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch

from photonormal.options import Rotations
from photonormal.solve.learned.weights import checksum, shipped
from photonormal.types import Capture, Normals


@dataclass(frozen=True)
class Learned(ABC):
    """A network that measures.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    rotations : 1, or 4 to average over quarter turns (four times the work)
    """

    weights: str = ""
    rotations: Rotations = 1
    name: ClassVar[str]  # in METHODS, and of the weights that come with the package

    @abstractmethod
    def __call__(self, capture: Capture, device: torch.device) -> Normals: ...

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped(self.name)

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)
