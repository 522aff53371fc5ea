"""GPS-Net: a graph of each pixel's samples, then its neighbours (Yao, Li, Fu, Hu, Shi, NeurIPS 2020)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from photonormal.methods.contract import Needs
from photonormal.methods.inputs.graphs import LEAF, leaves
from photonormal.methods.learned.layers import Block, conv, kaiming, unit
from photonormal.methods.learned.method import Learned
from photonormal.methods.learned.network import PixelNetwork, Step
from photonormal.methods.learned.pooling import Pooled, pool
from photonormal.methods.learned.processor import exactly

RELATION = 10  # channels between a leaf and its relation
SLOPE = 0.2  # of their LeakyReLU
CLOSEST = 1 - 1e-4  # cosines within can be distinguished, and have gradients


@dataclass(frozen=True)
class GPSNetConfig:
    """The network's switches; the defaults are the paper's.

    Parameters
    ----------
    filters : structure-aware filters, each with a mean and a maximum over the images
    order : Chebyshev polynomials of a filter
    width : channels of the layers that look around
    prior : always "": no classical method enters
    """

    filters: int = 32
    order: int = 32
    width: int = 64
    prior: str = ""


class GPSNet(PixelNetwork):
    """Grey images (b, n, 1, h, w) over their root mean square and lights (b, n, 3) to unit normals (b, 3, h, w)."""

    Config: ClassVar[type] = GPSNetConfig
    scaling = "grey"
    stride = 1

    def __init__(self, config: GPSNetConfig = GPSNetConfig()) -> None:
        super().__init__()
        self.config = config
        self.graph = Filters(config.filters, config.order)
        self.regressor = BranchedRegressor(2 * config.filters, config.width)
        kaiming(self.regressor)

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> None:
        return None

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        pooled = pool(self.graph(leaves(images[:, :, 0], lights)), total=True)  # (b h w, filters)
        size = images.shape[0], *images.shape[3:]
        return Pooled(*(None if x is None else x.unflatten(0, size) for x in pooled))  # type: ignore[arg-type]

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b h w c"]:
        assert pooled.total is not None
        return torch.cat([(pooled.total / n).to(pooled.maximum.dtype), pooled.maximum], dim=-1)

    def maps(self, digested: Float[Tensor, "b h w c"], shared: None) -> dict[str, Tensor]:
        return {"digested": digested.permute(0, 3, 1, 2)}  # channels last in memory

    def steps(self, n: int) -> list[Step]:
        return [Step("told", ("digested",), lambda x: unit(self.regressor(x)), reach=2)]


class Filters(nn.Module):
    """Structure-aware graph convolution of a star: how a leaf x relates to the pixel decides how its numbers weigh.

    r = tanh(s(s(x M1) M2) M3), s LeakyReLU; a filter V gives w = (T_0(r), ..., T_31(r)) V and x.w. One r serves all
    filters, as in the authors' code; the paper has one for each.
    """

    def __init__(self, filters: int, order: int) -> None:
        super().__init__()
        act = nn.LeakyReLU(SLOPE)
        first, second, third = (
            nn.Linear(a, b, bias=False) for a, b in ((LEAF, RELATION), (RELATION, RELATION), (RELATION, 1))
        )
        self.relation = nn.Sequential(first, act, second, act, third, nn.Tanh())
        self.V = nn.Linear(order * LEAF, filters, bias=False)
        self.order = order

    def forward(self, x: Float[Tensor, "p k 4"]) -> Float[Tensor, "p k f"]:
        with exactly(x.device):  # high degrees magnify what rounding does to r
            r = self.relation(x.float()).clamp(-CLOSEST, CLOSEST)  # (p, k, 1)
            T = torch.cos(torch.arange(self.order, device=x.device) * torch.acos(r))  # (p, k, order)
        return self.V((T[..., None] * x[..., None, :]).flatten(2))


class BranchedRegressor(nn.Sequential):
    """1 x 1 layers; then one branch that looks around and one that does not; both give the normal."""

    def __init__(self, inputs: int, width: int) -> None:
        w = width
        super().__init__(
            conv(inputs, w, size=1), Block(w, w, size=1), conv(w, 2 * w, size=1), Block(2 * w, 2 * w, size=1),
            Branches(
                nn.Sequential(conv(2 * w, 4 * w), conv(4 * w, w, size=1), Block(w, w, size=1)),
                nn.Sequential(conv(2 * w, 4 * w, size=1), conv(4 * w, w, size=1), Block(w, w, size=1)),
            ),
            nn.Conv2d(2 * w, 3, 3, padding=1, bias=False),
        )  # fmt: skip


class Branches(nn.ModuleList):
    """Several layers of the same features, side by side."""

    def __init__(self, *branches: nn.Module) -> None:
        super().__init__(branches)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        return torch.cat([branch(x) for branch in self], dim=1)


@dataclass(frozen=True)
class GPSNetMethod(Learned):
    """GPS-Net (Yao, Li, Fu, Hu, Shi, NeurIPS 2020): a graph of each pixel's samples; no prior."""

    name = "gps-net"
    needs: ClassVar[Needs] = Needs(images=4, reads="stream")
