"""The interface of every learned method: encode each image, pool over the images, decode once.

Training calls the network on a batch; measuring feeds the same three steps image by image. There is no second path.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor, nn

M = TypeVar("M", bound="Model")


@runtime_checkable
class Pool(Protocol):
    """What a network remembers of the images it has seen; `learned.pooling.Pooled` is one kind."""

    def merged(self, other: Any, /) -> Any:
        """This and what other images gave, in any order; may overwrite this one."""
        ...


class Model(nn.Module):
    """What a training trains and a weights file holds.

    Attributes
    ----------
    learns : "normals" (a `Network`), or "lights" (`learned.lightsnet`)
    scaling : what the images are divided by, so that exposure changes nothing: "exposure" (mean over the object),
        "channels" (each pixel's and channel's root mean square over the images) or "grey" (that of its grey level)
    exact : whether it computes in float32 on a processor unless the user asks for another format: bf16 saves it no time
    widens : whether `width` alone counts its channels and it holds only convolutions and concatenations, so that a
        network half as wide can begin it (`photonormal.train.begin`)
    Config : the frozen dataclass that `config` is one of
    config : what builds the network again; its field `prior` names a classical method, or is ""
    """

    Config: ClassVar[type]
    learns: ClassVar[str] = "normals"
    scaling: str
    exact: ClassVar[bool] = False
    widens: bool = False
    config: Any


class Network(Model, ABC):
    """Normals from images, lights and a prior.

    Attributes
    ----------
    stride : image sizes must be multiples of it
    reach : how many pixels away an input can change an output
    memory : channels that follow the normals in what `decode` gives and go into the next pass, beside the normals
    teaches : what `teach` gives: "attention" (how much each pixel is an edge), "images" (rendered back), "maps" (how
        wrong those are that were interpolated, and how far from symmetric) or "" (nothing)
    """

    stride: int
    reach: int
    memory: int = 0
    teaches: ClassVar[Literal["", "attention", "images", "maps"]] = ""

    @abstractmethod
    def begin(self, prior: Float[Tensor, "b c h w"], lights: Float[Tensor, "b n 3 *hw"] | None) -> Any:
        """What all images share, computed once from the prior (zero outside the object) and the lights of them all.

        The prior is normals (3 channels), or an earlier pass's normals and memory.
        """

    @abstractmethod
    def encode(self, images: Float[Tensor, "b k c h w"], lights: Float[Tensor, "b k 3 *hw"], shared: Any) -> Pool:
        """The pooled features of k scaled images: some of the n, or all."""

    def digest(self, pooled: Any, n: int, shared: Any) -> Any:
        """What is looked at of the pooled features of all n images."""
        return pooled

    @abstractmethod
    def look(self, digested: Any, n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        """Unit normals, `memory` channels, and from a network that has learned it the expected error in degrees."""

    def decode(self, pooled: Any, n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        """What `look` gives, from the pooled features of all n images."""
        return self.look(self.digest(pooled, n, shared), n, shared)

    def teach(
        self, images: Float[Tensor, "b n c h w"], lights: Float[Tensor, "b n 3 *hw"], digested: Any, N: Tensor
    ) -> Float[Tensor, "b e h w"]:
        """What a loss compares beside the normals N (b, 3, h, w) and no measurement needs: see `teaches`.

        `digested` is what `digest` gave.
        """
        raise NotImplementedError

    def forward(
        self,
        images: Float[Tensor, "b n c h w"],
        lights: Float[Tensor, "b n 3 *hw"],
        prior: Float[Tensor, "b 3 h w"],
        passes: int = 1,
    ) -> Float[Tensor, "q d h w"]:
        """What `decode` gives, from scaled images (`scaled`), unit lights and the prior; q is b times the passes.

        Lights are (b, n, 3), or (b, n, 3, h, w) where each pixel sees them elsewhere. The normals of a pass are the
        prior of the next, which learns to better them but not to have them otherwise; its memory learns to help.
        While it trains, what it `teaches` follows.
        """
        outside = prior.square().sum(1, keepdim=True) == 0
        found: list[Tensor] = []
        for _ in range(passes):
            shared = self.begin(prior, lights)
            digested = self.digest(self.encode(images, lights, shared), images.shape[1], shared)
            told = self.look(digested, images.shape[1], shared)
            if self.teaches and self.training:
                told = torch.cat([told, self.teach(images, lights, digested, told[:, :3])], dim=1)
            found.append(told)
            N, memory = found[-1][:, :3].detach(), found[-1][:, 3 : 3 + self.memory]
            prior = torch.cat([N, memory.to(N.dtype)], dim=1).masked_fill(outside, 0)
        return torch.cat(found) if passes > 1 else found[0]


class Step(NamedTuple):
    """A part of what looks around: from maps (b, d, h, w) to one map.

    Attributes
    ----------
    gives, reads : names of that map, and of those it is made from
    of : makes it
    reach : how far around it sees, in pixels of the picture
    stride : pixels of the picture to one of the map it gives, across and down
    """

    gives: str
    reads: tuple[str, ...]
    of: Callable[..., Tensor]
    reach: int = 0
    stride: int = 1


class PixelNetwork(Network):
    """A network that sees each pixel by itself, all its images at once, before it looks around.

    `encode` and `digest` see pixels alone; `begin` takes None for the lights where only what looks around follows. That
    is made of steps, so that a large picture can pass through them some rows after the other.
    """

    @abstractmethod
    def maps(self, digested: Float[Tensor, "b h w c"], shared: Any) -> dict[str, Tensor]:
        """What the steps begin with, by name."""

    @abstractmethod
    def steps(self, n: int) -> list[Step]:
        """What `look` does after n images; the last step gives its answer."""

    @property
    def reach(self) -> int:  # type: ignore[override]
        """Of all steps together, each a multiple of the stride."""
        return max(lateness(self.steps(1), self.stride).values())

    @abstractmethod
    def digest(self, pooled: Any, n: int, shared: Any) -> Float[Tensor, "b h w c"]:
        """What each pixel knows of all n images."""

    def look(self, digested: Float[Tensor, "b h w c"], n: int, shared: Any) -> Float[Tensor, "b d h w"]:
        maps, told = self.maps(digested, shared), None
        for step in self.steps(n):
            told = maps[step.gives] = step.of(*(maps[name] for name in step.reads))
        assert told is not None
        return told


def lateness(steps: Sequence[Step], stride: int) -> dict[str, int]:
    """By how many rows of the picture each step's map comes later than the maps that the steps begin with, where rows
    come one after the other: multiples of a stride."""
    late: dict[str, int] = {}
    for step in steps:
        late[step.gives] = max(late.get(name, 0) for name in step.reads) + -(-step.reach // stride) * stride
    return late


def at_pixels(lights: Float[Tensor, "b k 3 *hw"]) -> Float[Tensor, "b k 3 h w"]:
    """Lights of each pixel, or (b, k, 3, 1, 1) that all share."""
    return lights if lights.ndim == 5 else lights[..., None, None]


def placed(net: M, device: torch.device | str) -> M:
    """The network on a device, its filters in the memory order that convolutions are fastest with."""
    return net.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]


def parameters(network: nn.Module) -> int:
    """How many numbers the network has learned."""
    return sum(p.numel() for p in network.parameters())
