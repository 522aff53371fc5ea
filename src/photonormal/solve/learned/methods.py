"""The learned methods as entries of METHODS: each is one network kind, its weights, and options of the measurement."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from photonormal.solve.learned.measure import measure
from photonormal.solve.learned.network import Network
from photonormal.solve.learned.weights import checksum, load, shipped
from photonormal.types import Capture, InputError, Normals


@dataclass(frozen=True)
class LambertianPrior:
    """The paper's network (Ju et al., IEEE TIM 2021): least-squares normals guide a residual network.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    rotations : 1, or 4 to average over quarter turns (four times the work)
    prior : a classical method in place of the one that the weights were learned with; "": that one
    """

    weights: str = ""
    rotations: int = 1
    prior: str = ""

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        net = load(self.file, "lambertian-prior")
        return measure(net, capture, device, self.rotations, prior=self.prior or None)

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped("lambertian-prior")

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)


@dataclass(frozen=True)
class NormalNetMethod:
    """normalnet: a classical prior as the frame of a per-pixel network that then looks around.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    rotations : 1, or 4 to average over quarter turns (four times the work)
    prior : a classical method in place of the one that the weights were learned with; "": that one
    """

    weights: str = ""
    rotations: int = 1
    prior: str = ""

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        net = load(self.file, "normalnet")
        return measure(net, capture, device, self.rotations, prior=self.prior or None)

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped("normalnet")

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)


@dataclass(frozen=True)
class PSFCN:
    """PS-FCN (Chen, Han, Wong, ECCV 2018): no prior.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    rotations : 1, or 4 to average over quarter turns (four times the work)
    """

    weights: str = ""
    rotations: int = 1

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        return measure(psfcn(self.file, normalised=False), capture, device, self.rotations)

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped("psfcn")

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)


@dataclass(frozen=True)
class PSFCNNormalised:
    """PS-FCN on normalised observations (Chen, Han, Shi, Matsushita, Wong, TPAMI 2020): no prior.

    Parameters
    ----------
    weights : a weights file of your own; "": the one that comes with the package
    rotations : 1, or 4 to average over quarter turns (four times the work)
    """

    weights: str = ""
    rotations: int = 1

    def __call__(self, capture: Capture, device: torch.device) -> Normals:
        return measure(psfcn(self.file, normalised=True), capture, device, self.rotations)

    @property
    def file(self) -> Path:
        """The weights file."""
        return Path(self.weights) if self.weights else shipped("psfcn-normalised")

    @property
    def weights_sha256(self) -> str:
        """Checksum of the weights, for reports."""
        return checksum(self.file)


def psfcn(file: Path, normalised: bool) -> Network:
    """PS-FCN's network from a weights file that was trained with or without normalised observations."""
    net = load(file, "psfcn")
    if net.config.normalised != normalised:
        kind = "psfcn-normalised" if net.config.normalised else "psfcn"
        raise InputError(f"weights {file} are for {kind}; measure with method {kind}, or give other weights.")
    return net
