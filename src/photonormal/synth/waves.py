"""Random fields without a lattice: sums of plane waves, smooth, differentiable and defined everywhere in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.synth.params import log_uniform, tensor, unit_vectors

WAVES = 8  # of a field that is drawn


@dataclass(frozen=True)
class Waves:
    """`k` fields of `m` waves each for `b` scenes: f(p) = sum_m a_m sin(w_m . p + phase_m), of variance one."""

    w: Float[Tensor, "b km 3"]  # radians per unit of length
    phase: Float[Tensor, "b km 1"]
    a: Float[Tensor, "b k m"]

    def __call__(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b k p"]:
        b, k, m = self.a.shape
        s = torch.baddbmm(self.phase, self.w, p).sin()  # (b, k m, p)
        return torch.einsum("bkmp,bkm->bkp", s.view(b, k, m, -1), self.a)


def draw_waves(g: np.random.Generator, frequency: np.ndarray, octaves: float) -> Waves:
    """Fields around the angular frequencies `frequency` (b, k), spread over `octaves` with amplitude falling as 1/f."""
    b, k = frequency.shape
    f = frequency[..., None] * 2 ** (octaves * np.linspace(0, 1, WAVES)) * log_uniform(g, 0.85, 1.18, (b, k, WAVES))
    a = frequency[..., None] / f
    a *= np.sqrt(2 / (a**2).sum(-1, keepdims=True))
    w = unit_vectors(g, (b, k, WAVES)) * f[..., None]  # (b, k, m, 3)
    return Waves(
        tensor(w.reshape(b, k * WAVES, 3)),
        tensor(g.uniform(0, 2 * np.pi, (b, k * WAVES, 1))),
        tensor(a),
    )
