"""What passes between the engine and a method: what a method reads, what it is shown, what it returns.

A method never sees files, windows, lamps or devices; the engine (`photonormal.methods.engine`) owns those. There are
two interfaces: `Solver`, which is shown samples, and `Streaming`, whose network is fed image by image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.types import InputError


@dataclass(frozen=True)
class Needs:
    """What a method declares of itself.

    Parameters
    ----------
    images : least number of them, each under its own light
    lights : whether it needs the light directions; else it finds them, or does without
    finds_lights : it returns them where it was not given them
    reads : "pixels", each by itself; "stream", images one after the other; "object", all samples at once
    optimises : it learns while it measures, so gradients are kept
    double : it computes in double precision
    """

    images: int = 3
    lights: bool = True
    finds_lights: bool = False
    reads: Literal["pixels", "stream", "object"] = "pixels"
    optimises: bool = False
    double: bool = False


@dataclass(frozen=True)
class Observations:
    """What a method is shown of `p` pixels on the mask, row by row, under `n` lights.

    Parameters
    ----------
    I : (p, n) grey levels, not negative; cut at 1, or at the 99th percentile of the capture where that is above 1
    keep : (p, n) bool, samples that are lit, by the whole capture's threshold
    L : (n, 3) unit lights, or (p, n, 3) where each pixel sees them elsewhere; None where they are unknown
    metallic : returns whether light comes off the whole object in highlights alone
    mask : (h, w) bool where these pixels lie, p of them; of a method by pixels, any shape
    pictures : the same samples as linear pictures (n, c, h, w), zero outside the mask; for methods of whole objects
    """

    I: Float[Tensor, "p n"]
    keep: Bool[Tensor, "p n"]
    L: Float[Tensor, "*l n 3"] | None
    metallic: Callable[[], bool] = field(default=bool, repr=False)
    mask: Bool[Tensor, "h w"] | None = None
    pictures: Callable[[], Tensor] | None = field(default=None, repr=False)

    @property
    def lights(self) -> Float[Tensor, "*l n 3"]:
        """The lights of a method that needs them."""
        assert self.L is not None
        return self.L


@dataclass(frozen=True)
class Solution:
    """What a method knows of `p` pixels.

    Parameters
    ----------
    normals : (p, 3) unit, zero where there is none
    told_deg : (p,) how far the method itself expects each normal to be off, degrees; None: it doesn't say
    lights : (n, 3) unit, where the method found them
    intensities : (n,) of the lights, where the method found them, up to one factor
    """

    normals: Float[Tensor, "p 3"]
    told_deg: Float[Tensor, " p"] | None = None
    lights: Float[Tensor, "n 3"] | None = None
    intensities: Float[Tensor, " n"] | None = None

    def __post_init__(self):
        if not isinstance(self.normals, Tensor) or self.normals.ndim != 2 or self.normals.shape[1] != 3:
            came = f"{type(self.normals).__name__} of {tuple(getattr(self.normals, 'shape', ()))}"
            raise InputError(
                f"a method returned normals as {came} but a torch.Tensor (p, 3), a row a pixel, is needed."
            )

    @staticmethod
    def joined(parts: Sequence[Solution]) -> Solution:
        """The solutions of several sets of pixels, one after the other."""
        if len(parts) == 1:
            return parts[0]
        told = [s.told_deg for s in parts if s.told_deg is not None]
        return Solution(torch.cat([s.normals for s in parts]), torch.cat(told) if told else None)

    def cpu(self) -> Solution:
        """The same as float32 on the processor."""
        found = (self.normals, self.told_deg, self.lights, self.intensities)
        return Solution(*(v if v is None else v.detach().to("cpu", torch.float32) for v in found))  # pyright: ignore[reportArgumentType]


@runtime_checkable
class Method(Protocol):
    """A frozen dataclass whose fields are its options."""

    @property
    def needs(self) -> Needs:
        """What it reads."""
        ...


@runtime_checkable
class Solver(Method, Protocol):
    """A method that is shown samples: some pixels at a time, or the whole object."""

    def __call__(self, seen: Observations) -> Solution:
        """What it finds."""
        ...


@runtime_checkable
class Streaming(Method, Protocol):
    """A method whose network is fed the images one after the other (`photonormal.methods.learned.network.Network`)."""

    rotations: int
    """1, or 4 to average over quarter turns."""
    passes: ClassVar[int] | int
    """How often the network looks; from the second time on its own normals are the prior."""
    prior: ClassVar[str] | str
    """A classical method in place of the network's own prior; "": that one."""
    fast: ClassVar[bool] | bool
    """Whether the network looks at half the resolution (`photonormal.methods.engine.halved`)."""
    exact: ClassVar[bool]
    """Whether it computes in float32 on a processor unless the user asks for another format."""

    def network(self) -> Any:
        """The network with its weights."""
        ...

    def lights_network(self) -> Any:
        """The network that finds the lights under which the other looks; None where the method gets them."""
        ...

    def brightened(self, seen: Callable[[], Observations]) -> Float[Tensor, " n"] | None:
        """Factors by which pictures are brighter than their lights' intensities say, found from some pixels, which the
        network is to see divided by them; None where the method doesn't ask."""
        ...


@runtime_checkable
class Prior(Protocol):
    """A method that a network can start from, in training and in measuring: it takes whole batches."""

    def normals(
        self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"], dark: float | None = None
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals, zero where there is none, from grey levels and lights; leading batch dimensions are allowed.

        `dark`: grey level below which a sample is in shadow; None: what these samples show of it.
        """
        ...
