"""What networks share that read observation maps: the dense network of CNN-PS, and the way from images to normals."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import pi
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from photonormal.methods.inputs.maps import about_view, brightest_one, observation_maps
from photonormal.methods.learned.layers import unit
from photonormal.methods.learned.method import Weighted
from photonormal.methods.learned.network import Network, PixelNetwork, Step, at_pixels
from photonormal.methods.learned.pooling import Pooled
from photonormal.options import Turns

TURNS = 2  # unless a method is asked for others
MAPS = 256  # that a network looks at together: what it makes of them suits a processor's cache


class MapNetwork(PixelNetwork):
    """Normals of each pixel by itself, from its observation map.

    Attributes
    ----------
    side : of a map, in cells
    net : what reads them
    turns : how many turns of the lights, evenly around the view, measured normals are a mean of; one in training
    """

    scaling = "grey"
    stride = 1
    turns: int = TURNS

    def __init__(self, config: Any, channels: int = 1) -> None:
        super().__init__()
        self.config = c = config
        self.side = c.side
        self.net = DenseNet(c.side, channels, c.grown, c.hidden)

    @abstractmethod
    def projection(self, L: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 2"]:
        """Where lights are in a map, from -1 to 1 across and up."""

    def read(self, maps: Float[Tensor, "q s s"]) -> Float[Tensor, "q c s s"]:
        """What the dense network reads: maps whose brightest cell is 1, and what else is made of them."""
        return maps[:, None]

    def begin(self, prior: Float[Tensor, "b 3 h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> None:
        return None

    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pooled:
        b, k, _, h, w = images.shape
        I = images[:, :, 0].permute(0, 2, 3, 1).reshape(-1, k)  # (p, k)
        L = at_pixels(lights).permute(0, 3, 4, 1, 2)  # (b, h or 1, w or 1, k, 3)
        L = L.flatten(0, 3) if L.shape[:3].numel() == 1 else L.expand(b, h, w, k, 3).reshape(-1, k, 3)
        maps = [observation_maps(I, about_view(L, angle), self.side, self.projection) for angle in self.angles()]
        return Pooled(torch.stack(maps, dim=1).unflatten(0, (b, h, w)))  # (b, h, w, turns, s, s)

    def digest(self, pooled: Pooled, n: int, shared: Any) -> Float[Tensor, "b h w d"]:
        """Normals, and while it trains the cells of what was made of the maps."""
        size = pooled.maximum.shape[:4]  # b, h, w, turns
        N, made = [], []
        for maps in brightest_one(pooled.maximum.flatten(0, 3)).split(MAPS):
            x = self.read(maps)
            N.append(unit(self.net(x)))
            made.append(x[:, 1:].flatten(1))
        angles = torch.tensor(self.angles(), device=pooled.maximum.device)
        mean = about_view(torch.cat(N).unflatten(0, size), -angles).mean(3)
        return torch.cat([mean, torch.cat(made).unflatten(0, size)[..., 0, :]], dim=-1) if self.training else mean

    def angles(self) -> list[float]:
        """Of the turns, in radians."""
        turns = 1 if self.training else self.turns
        return [2 * pi * turn / turns for turn in range(turns)]

    def maps(self, digested: Float[Tensor, "b h w d"], shared: None) -> dict[str, Tensor]:
        return {"mean": digested[..., :3].permute(0, 3, 1, 2)}

    def steps(self, n: int) -> list[Step]:
        return [Step("told", ("mean",), unit)]


@dataclass(frozen=True)
class OfMaps(Weighted):
    """A network of observation maps that measures.

    Parameters
    ----------
    turns : how many turns of the lights about the view the normals are a mean of; the work grows with them
    """

    turns: Turns = TURNS

    def network(self) -> Network:
        net = super().network()
        assert isinstance(net, MapNetwork)
        net.turns = self.turns
        return net


class DenseNet(nn.Module):
    """The network of CNN-PS: maps of a few channels to normals; each convolution reads what all before it gave.

    Glorot's initial weights, as the paper's library has them; no dropout, as no map of a stream comes twice.
    """

    def __init__(self, side: int, channels: int = 1, grown: int = 16, hidden: int = 128) -> None:
        super().__init__()
        g = grown
        self.first = nn.Conv2d(channels, g, 3, padding=1)
        self.fine = nn.ModuleList([nn.Conv2d(g, g, 3, padding=1), nn.Conv2d(2 * g, g, 3, padding=1)])
        self.mixed = nn.Conv2d(3 * g, 3 * g, 1)
        self.coarse = nn.ModuleList([nn.Conv2d(3 * g, g, 3, padding=1), nn.Conv2d(4 * g, g, 3, padding=1)])
        self.last = nn.Conv2d(5 * g, 5 * g, 1)
        self.dense = nn.Linear(5 * g * (side // 2) ** 2, hidden)
        self.normal = nn.Linear(hidden, 3)
        for module in self.modules():
            if isinstance(module, nn.Conv2d | nn.Linear) and module.bias is not None and not module.weight.is_meta:
                nn.init.xavier_uniform_(module.weight)
                nn.init.zeros_(module.bias)

    def forward(self, x: Float[Tensor, "q c s s"]) -> Float[Tensor, "q 3"]:
        x = self.first(x.contiguous(memory_format=torch.channels_last))
        for conv in self.fine:
            x = torch.cat([x, conv(F.relu(x))], dim=1)
        x = F.avg_pool2d(self.mixed(F.relu(x)), 2)
        for conv in self.coarse:
            x = torch.cat([x, conv(F.relu(x))], dim=1)
        x = F.relu(self.last(F.relu(x)))
        return self.normal(F.relu(self.dense(x.permute(0, 2, 3, 1).flatten(1))))
