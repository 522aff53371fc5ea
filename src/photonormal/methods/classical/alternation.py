"""One reflectance for the whole object and one normal for each pixel, found in turn: what `table` and `ward` share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.monotonic import Monotonic
from photonormal.methods.classical.ransac import Ransac
from photonormal.methods.classical.refine import Refinement
from photonormal.methods.contract import Observations
from photonormal.methods.inputs.blocks import blocks, every_pixel, some_pixels
from photonormal.methods.inputs.workers import side_by_side
from photonormal.resources import by_one_thread


@runtime_checkable
class Reflectance(Protocol):
    """What an object is made of, under given lights."""

    def fitted(
        self, some: Tensor, I: Float[Tensor, "q n"], keep: Bool[Tensor, "q n"], n: Float[Tensor, "q 3"]
    ) -> Reflectance:
        """The reflectance that explains the samples to `keep` of some pixels best, given their normals."""
        ...

    def model(
        self, some: slice, I: Float[Tensor, "p n"], keep: Bool[Tensor, "p n"], n: Float[Tensor, "p 3"]
    ) -> Callable[[Tensor], Tensor]:
        """Radiance (p, n) of some pixels as a function of their normals (p, 3), to scale; `n` are their normals now."""
        ...


@dataclass(frozen=True)
class Alternation:
    """The reflectance is fitted to some pixels, then all normals are refined under it, in turn.

    That is done from two starts, one that is right on matt surfaces and one that is right on metal; each pixel keeps
    the answer that explains it better.

    Parameters
    ----------
    sample : pixels that the reflectance is fitted to
    rounds : of fitting, then refining
    matt, metal : give the two starts
    refinement : of the normals
    """

    sample: int
    rounds: int
    matt: Ransac = field(default=Ransac(triplets=60))
    metal: Monotonic = field(default=Monotonic())
    refinement: Refinement = field(default=Refinement())

    def __call__(self, first: Callable[[Tensor], Reflectance], seen: Observations) -> Float[Tensor, "p 3"]:
        """Normals of an object; `first` maps lights to the reflectance to begin with."""
        I, keep, L = seen.I, seen.keep, seen.lights
        (n, loss), (n_metal, loss_metal) = (
            self.refine(first(L), I, keep, L, every_pixel(start.fit, I, keep, L)) for start in (self.matt, self.metal)
        )
        return torch.where(loss_metal < loss, n_metal, n)

    def refine(
        self,
        reflectance: Reflectance,
        I: Float[Tensor, "p n"],
        keep: Bool[Tensor, "p n"],
        L: Float[Tensor, "*l n 3"],
        n: Float[Tensor, "p 3"],
    ) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 1"]]:
        """Normals, from those of one start, and their loss; computed where the lights are."""
        loss = torch.zeros_like(n[:, :1])
        some = some_pixels(I.shape[0], self.sample)
        samples, kept = I[some].to(L), keep[some].to(L.device)
        some = some.to(L.device)
        for _ in range(self.rounds):
            with by_one_thread():
                reflectance = reflectance.fitted(some, samples, kept, n[some])

            def refined(s: slice, reflectance: Reflectance = reflectance) -> None:
                block, lit_here = I[s].to(L), keep[s].to(L.device)
                n[s], loss[s] = self.refinement(reflectance.model(s, block, lit_here, n[s]), block, lit_here, n[s])

            side_by_side(refined, blocks(I.shape[0], I.shape[1], L.device), L.device)
        return n, loss
