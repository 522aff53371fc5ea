"""Least squares on the samples of middle brightness: the darkest are shadows, the brightest are highlights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.classical.woodham import weighted_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.inputs.grey import ascending, lit
from photonormal.options import Effort, Share
from photonormal.shading import normalised
from photonormal.types import InputError


@dataclass(frozen=True)
class Trimmed:
    """Of a pixel's lit samples, only those whose brightness ranks in a window enter the linear fit.

    Exact on a matt surface; holds while shadows and highlights leave the window free. Needs 3 lights.

    Parameters
    ----------
    lowest, highest : window of ranks among the lit samples, fractions in [0, 1]
    least : samples that the window holds at least; few lights widen it
    """

    lowest: Share = 0.1
    highest: Share = 0.6
    least: Effort = 6

    def __post_init__(self) -> None:
        if self.lowest >= self.highest:
            raise InputError(
                f"a window of ranks from lowest={self.lowest} to highest={self.highest} is empty; give a higher end."
            )

    needs: ClassVar[Needs] = Needs()

    def __call__(self, seen: Observations) -> Solution:
        return Solution(self.fit(seen.I, seen.keep, seen.lights))

    def normals(
        self, I: Float[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"], dark: float | None = None
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from grey levels and lights; leading batch dimensions are allowed. `dark`: see `Prior`."""
        return self.fit(I, lit(I, dark), L)

    def fit(
        self, I: Float[Tensor, "*b p n"], keep: Bool[Tensor, "*b p n"], L: Float[Tensor, "*l n 3"]
    ) -> Float[Tensor, "*b p 3"]:
        """Unit normals from the samples to `keep`."""
        return normalised(weighted_normals(I, keep & self.window(I, keep), L))

    def window(
        self, I: Float[Tensor, "*b p n"], keep: Bool[Tensor, "*b p n"], ranked: Float[Tensor, "*b p n"] | None = None
    ) -> Bool[Tensor, "*b p n"]:
        """Samples whose value lies between those of the window's first and last rank, ties included.

        `ranked`: each pixel's samples from dark to bright, where that is known.
        """
        share = self.highest - self.lowest
        count = keep.to(I.dtype).sum(-1, keepdim=True)  # (*b, p, 1)
        inside = torch.maximum(share * count, count.clamp(max=self.least))
        first = (self.lowest / max(1 - share, 1e-9) * (count - inside)).round()
        last = (first + inside.round() - 1).clamp(min=0)
        dark = I.shape[-1] - count  # they rank below all lit samples
        ranked = ascending(I) if ranked is None else ranked
        low = ranked.gather(-1, (dark + first).long().clamp(max=I.shape[-1] - 1))
        high = ranked.gather(-1, (dark + last).long().clamp(max=I.shape[-1] - 1))
        return (I >= low) & (I <= high)
