"""DPSN: H. Santo, M. Samejima, Y. Sugano, B. Shi, Y. Matsushita, "Deep photometric stereo network", ICCVW 2017.

The paper takes the mean of the normals of three channels; here the network reads grey levels, scaled and cut as those
of all networks of pixels are. Of its dropout that of the samples stays, its shadow layer, as `dark` of a training's
recipe, with a fixed rate: no sample of a stream comes twice.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from photonormal.methods.inputs.rig import lamps_of
from photonormal.methods.learned.layers import unit
from photonormal.methods.learned.method import Weighted
from photonormal.methods.learned.network import PixelNetwork, Step
from photonormal.methods.learned.pooling import Pooled
from photonormal.shading import normalised
from photonormal.types import InputError


@dataclass(frozen=True)
class DPSNConfig:
    """The network's switches; the defaults have 34 million parameters under 96 lights.

    Parameters
    ----------
    width : of the first two hidden layers; the next three have half of it
    lights : unit directions of the rig
    prior : always "": no classical method enters
    """

    width: int = 4096
    lights: tuple[tuple[float, float, float], ...] = field(default=(), repr=False)
    prior: str = ""

    def __post_init__(self) -> None:
        if len(self.lights) < 3:
            raise InputError(f"{len(self.lights)} lights came but dpsn learns for a rig of 3 or more; name its lights.")


class Rig(NamedTuple):
    """All lights of a capture, as pixels see them or their mean, and which lamps they are."""

    lights: Float[Tensor, "n 3"]
    lamps: Int[Tensor, " n"]


class DPSNNet(PixelNetwork):
    """Samples of each pixel, one under each lamp of the rig, to unit normals."""

    Config: ClassVar[type] = DPSNConfig
    scaling = "grey"
    stride = 1

    def __init__(self, config: DPSNConfig) -> None:
        super().__init__()
        self.config = config
        w, n = config.width, len(config.lights)
        sizes = (n, w, w, w // 2, w // 2, w // 2)
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.normal = nn.Linear(w // 2, 3)
        for layer in self.hidden:
            if not layer.weight.is_meta:  # else the weights come from a file
                nn.init.kaiming_normal_(layer.weight)  # type: ignore[arg-type]
                nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> Rig | None:
        if lights is None:
            return None
        L = lights if lights.ndim == 3 else lights.permute(0, 3, 4, 1, 2)  # (b, n, 3) or (b, h, w, n, 3)
        lamps = lamps_of(L, torch.tensor(self.config.lights, device=L.device))
        return Rig(normalised(L.flatten(0, -3).mean(0)), lamps)

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        I = images[:, :, 0].permute(0, 2, 3, 1)  # (b, h, w, k)
        L = lights if lights.ndim == 3 else lights.mean((3, 4))
        lamps = shared.lamps[(L.mean(0) @ shared.lights.T).argmax(1)]  # (k,)
        found = I.new_zeros(*I.shape[:3], len(self.config.lights))
        return Pooled(found.index_copy_(3, lamps, I))

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b h w 3"]:
        x = pooled.maximum
        for layer in self.hidden:
            x = torch.relu(layer(x))
        return self.normal(x).float()

    def maps(self, digested: Float[Tensor, "b h w 3"], shared: Rig | None) -> dict[str, Tensor]:
        return {"digested": digested.permute(0, 3, 1, 2)}

    def steps(self, n: int) -> list[Step]:
        return [Step("told", ("digested",), unit)]


@dataclass(frozen=True)
class DPSN(Weighted):
    """DPSN (Santo et al., ICCVW 2017): each pixel by itself, from its samples under the lamps of one rig.

    The weights are for one rig, those that come with the package for DiLiGenT's; under other lights it is refused.
    """

    name = "dpsn"
