"""SDPS-Net (Chen, Han, Shi, Matsushita, Wong, CVPR 2019): one network finds the lights, another the normals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from photonormal.methods.contract import Needs
from photonormal.methods.learned.lightsnet import LightsNet
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import Network
from photonormal.methods.learned.psfcn import PSFCN, psfcn
from photonormal.methods.learned.weights import LIGHTS, checksum, load_network, shipped
from photonormal.methods.uncalibrated.limits import LEAST


@dataclass(frozen=True)
class SDPS(Learned):
    """SDPS-Net: photographs alone; lights that are given aren't looked at.

    The lights' network is `lightsnet`, and the normals' is PS-FCN: it reads the directions that the first told, on
    images that are divided by its intensities. Neither is corrected by the other. PS-FCN has the weights of `psfcn`,
    which learned under lights that are off by a degree; minutes under lights that the first found made it worse.

    Parameters
    ----------
    weights : a weights file of your own for PS-FCN, such as the recipe `sdps` makes; "": that of `psfcn`
    lights : a weights file of your own for the lights' network; "": the one that comes with the package
    """

    lights: str = ""
    name = "sdps"
    needs = Needs(images=LEAST, lights=False, finds_lights=True, reads="stream")

    @property
    def file(self) -> Path:
        """The weights file of PS-FCN."""
        return Path(self.weights) if self.weights else shipped(PSFCN.name)

    def network(self) -> Network:
        return psfcn(self.file, normalised=False)

    def lights_network(self) -> LightsNet:
        return load_network(self.lights_file, "lightsnet")

    @property
    def lights_file(self) -> Path:
        """The weights file of the lights' network."""
        return Path(self.lights) if self.lights else shipped(LIGHTS)

    @property
    def weights_sha256(self) -> str:
        """Checksums of both files."""
        return f"{checksum(self.file)} {checksum(self.lights_file)}"
