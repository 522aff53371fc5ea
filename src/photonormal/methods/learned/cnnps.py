"""CNN-PS: S. Ikehata, "CNN-PS: CNN-based photometric stereo for general non-convex surfaces", ECCV 2018."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from jaxtyping import Float
from torch import Tensor

from photonormal.methods.inputs.maps import seen_from_above
from photonormal.methods.learned.maps import MapNetwork, OfMaps


@dataclass(frozen=True)
class CNNPSConfig:
    """The network's switches; the defaults have 2.65 million parameters.

    Parameters
    ----------
    side : of an observation map, in cells
    grown : channels that each convolution adds
    hidden : width of the layer before the normal
    prior : always "": no classical method enters
    """

    side: int = 32
    grown: int = 16
    hidden: int = 128
    prior: str = ""


class CNNPSNet(MapNetwork):
    """Observation maps of grey levels, the hemisphere of lights seen from above, to unit normals."""

    Config: ClassVar[type] = CNNPSConfig

    def __init__(self, config: CNNPSConfig = CNNPSConfig()) -> None:
        super().__init__(config)

    def projection(self, L: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
        return seen_from_above(L)


@dataclass(frozen=True)
class CNNPS(OfMaps):
    """CNN-PS (Ikehata, ECCV 2018): each pixel by itself, from its observation map.

    The network knows no direction around the view as another; the mean over turns of the lights evens out what it has
    learned of each; the paper takes ten.

    Parameters
    ----------
    weights, turns : see OfMaps
    """

    name = "cnn-ps"
