"""LMPS: J. Li, A. Robles-Kelly, S. You, Y. Matsushita, "Learning to minify photometric stereo", CVPR 2019.

Few lights, and which: the network measures under any of a rig's lamps, so that it can be asked what each is worth
(`photonormal.lamp_choice`). The paper learns that as a table over the cells of one rig's map, with the network.
Where its occlusion layer blackens one side of a chord through the map, samples are made black by chance, as `dark` of a
training's recipe says.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Float
from torch import Tensor

from photonormal.methods.inputs.maps import by_angles
from photonormal.methods.learned.maps import MapNetwork, OfMaps


@dataclass(frozen=True)
class LMPSConfig:
    """The network's switches; the defaults are the paper's.

    Parameters
    ----------
    side : of an observation map, in cells
    reach_deg : angle against the view, across or up, at the map's border
    grown : channels that each convolution adds
    hidden : width of the layer before the normal
    prior : always "": no classical method enters
    """

    side: int = 14
    reach_deg: int = 45
    grown: int = 16
    hidden: int = 128
    prior: str = ""


class LMPSNet(MapNetwork):
    """Observation maps of grey levels by angles of the lights, to unit normals."""

    Config: ClassVar[type] = LMPSConfig

    def __init__(self, config: LMPSConfig = LMPSConfig()) -> None:
        super().__init__(config)

    def projection(self, L: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
        return by_angles(L, float(self.config.reach_deg))


@dataclass(frozen=True)
class LMPS(OfMaps):
    """LMPS (Li et al., CVPR 2019): each pixel by itself, from a small observation map; made for few lights.

    Parameters
    ----------
    weights, turns : see OfMaps
    """

    name = "lmps"
