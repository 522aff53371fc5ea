"""What the learned methods share: options of a measurement, and the weights that come with the package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from torch import Tensor

from photonormal.methods.contract import Needs, Observations
from photonormal.methods.learned.network import Network
from photonormal.methods.learned.weights import checksum, load_network, shipped
from photonormal.options import Rotations


@dataclass(frozen=True)
class Weighted:
    """A network that measures; in quarter turns of the photographs nothing is to gain.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    """

    weights: str = ""
    name: ClassVar[str]  # in METHODS, and of the weights that come with the package
    needs: ClassVar[Needs] = Needs(reads="stream")
    rotations = 1  # these unless a method has them as options
    passes = 1
    prior = ""
    fast = False
    exact = False

    def network(self) -> Network:
        """The network with its weights."""
        return load_network(self.file, self.name)

    def lights_network(self) -> Any:
        """None: lights are given."""
        return None

    def brightened(self, seen: Callable[[], Observations]) -> Tensor | None:
        """None: pictures are seen as they are."""
        return None

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped(self.name)

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)


@dataclass(frozen=True)
class Learned(Weighted):
    """A network that measures, and that looks around each pixel.

    Parameters
    ----------
    rotations : 1, or 4 to average over quarter turns (four times the work)
    """

    rotations: Rotations = 1
