"""My method: least squares without the darkest and the brightest third of the samples of each pixel."""

import sys
from dataclasses import dataclass
from typing import ClassVar

from photonormal.cli import main
from photonormal.methods import METHODS
from photonormal.methods.classical.woodham import weighted_normals
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.shading import normalised

METHODS["mine"] = "mine:Mine"


@dataclass(frozen=True)
class Mine:
    """What every pixel's brightest and darkest `left_out` of its samples say is not believed."""

    left_out: float = 0.33
    needs: ClassVar[Needs] = Needs()

    def __call__(self, seen: Observations) -> Solution:
        low, high = (seen.I.quantile(q, dim=-1, keepdim=True) for q in (self.left_out, 1 - self.left_out))
        kept = (seen.I >= low) & (seen.I <= high)
        return Solution(normalised(weighted_normals(seen.I, kept, seen.lights)))


if __name__ == "__main__":
    sys.exit(main())
