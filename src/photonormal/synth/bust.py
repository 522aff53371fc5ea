"""One solid that is not drawn at random: a glazed bust, for the capture that the package ships as a demonstration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.synth.materials import PALETTE, SEEDS, Coats, draw_coats
from photonormal.synth.params import rng, tensor
from photonormal.synth.shapes import Field, smooth_max

# centre and semi-axes of ellipsoids, y up, z out of the face
FACE = [
    ((0, 0.44, -0.04), (0.35, 0.40, 0.42)),  # skull
    ((0, 0.20, 0.10), (0.25, 0.33, 0.29)),  # face
    ((0, 0.30, 0.40), (0.052, 0.13, 0.075)),  # bridge of the nose
    ((0, 0.205, 0.455), (0.062, 0.055, 0.07)),  # its tip
    ((0.13, 0.415, 0.325), (0.12, 0.045, 0.09)),  # brows
    ((-0.13, 0.415, 0.325), (0.12, 0.045, 0.09)),
    ((0.145, 0.19, 0.26), (0.10, 0.11, 0.10)),  # cheeks
    ((-0.145, 0.19, 0.26), (0.10, 0.11, 0.10)),
    ((0, 0.085, 0.375), (0.105, 0.028, 0.055)),  # lips
    ((0, 0.03, 0.365), (0.085, 0.033, 0.055)),
    ((0, -0.075, 0.29), (0.11, 0.085, 0.10)),  # chin
    ((0.135, 0.325, 0.285), (0.075, 0.062, 0.075)),  # eyes
    ((-0.135, 0.325, 0.285), (0.075, 0.062, 0.075)),
    ((0, -0.30, -0.04), (0.19, 0.45, 0.19)),  # neck
]
HAIR = [
    ((0, 0.56, -0.12), (0.415, 0.37, 0.43)),
    ((0.33, 0.36, -0.02), (0.13, 0.30, 0.22)),
    ((-0.33, 0.36, -0.02), (0.13, 0.30, 0.22)),
    ((0, 0.98, -0.20), (0.20, 0.17, 0.20)),  # the knot
    ((0.30, 0.00, -0.14), (0.12, 0.26, 0.16)),
]
CLOTH = [
    ((0, -0.86, -0.08), (0.80, 0.40, 0.36)),
    ((0.42, -0.70, 0.02), (0.30, 0.26, 0.24)),
    ((-0.42, -0.70, 0.02), (0.30, 0.26, 0.24)),
]


@dataclass(frozen=True)
class Bust:
    """A head with hair and drapery, turned by R; offers what `Solids` offers."""

    R: Float[Tensor, "b 3 3"]  # own frame -> world
    reach: Float[Tensor, " b"]  # largest displacement

    @property
    def detail(self) -> Bust:
        return self

    def bound(self) -> Float[Tensor, " b"]:
        """Largest displacement outwards."""
        return self.reach

    def trimmed(self) -> Bust:
        return self

    def base_field(self) -> Field:
        """Distance without the displacement."""
        return self.base

    def field(self) -> Field:
        """About the signed distance to the surface."""
        return self

    def base(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        """Distance without the displacement."""
        q = self.R.transpose(1, 2) @ p
        k = 0.035
        parts = [_union(q, FACE, k), _union(q, HAIR, 0.03), _union(q, CLOTH, 0.08)]
        return _cut(-0.012 * torch.logsumexp(torch.stack(parts, 1) / -0.012, 1), q)

    def __call__(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        """About the signed distance to the surface."""
        q = self.R.transpose(1, 2) @ p
        x, y, z = q.unbind(1)
        strands = torch.sin(34 * torch.atan2(x, z + 0.35) + 5 * torch.sin(4 * y) + 7 * y)
        waves = torch.sin(11 * y + 6 * x * x + 2 * torch.sin(5 * z))
        hair = _union(q, HAIR, 0.03) - 0.012 * strands - 0.014 * waves
        drape = torch.sin(26 * x + 15 * y * x + 4 * torch.sin(5 * y)) + 0.5 * torch.sin(9 * y - 14 * x.abs())
        neckline = torch.exp(-((y + 0.56 + 0.25 * x.square()) / 0.045).square())
        cloth = _union(q, CLOTH, 0.08) - 0.022 * drape - 0.05 * neckline
        lips = 0.012 * torch.exp(-((y - 0.058) / 0.012).square() - (x / 0.09).square()) * (z > 0.2)
        lids = 0.02 * torch.exp(-(((y - 0.335 + 2 * (x.abs() - 0.135).square()) / 0.013).square()))
        lids = lids * torch.exp(-(((x.abs() - 0.135) / 0.065).square().square())) * (z > 0.2)
        face = _union(q, FACE, 0.035) + lips - lids
        return _cut(-0.012 * torch.logsumexp(torch.stack([face, hair, cloth], 1) / -0.012, 1), q)


def _union(q: Tensor, parts: list, k: float) -> Tensor:
    c = q.new_tensor([part[0] for part in parts])[..., None]  # (k, 3, 1)
    a = q.new_tensor([part[1] for part in parts])[..., None]
    r = ((q[:, None] - c) / a).square().sum(2).add(1e-12).sqrt()  # (b, k, p)
    return -k * torch.logsumexp((r - 1) * a.amin(1) / -k, 1)


def _cut(d: Tensor, q: Tensor) -> Tensor:
    """The flat foot."""
    return smooth_max(d, -1.02 - q[:, 1], 0.01)


def busts(g: np.random.Generator, b: int) -> Bust:
    """`b` busts, each turned a little differently about the vertical."""
    turn = np.radians(np.where(np.arange(b) == 0, -28.0, g.uniform(-60, 60, b)))
    R = np.zeros((b, 3, 3))
    R[:, 1, 1] = 1
    R[:, 0, 0] = R[:, 2, 2] = np.cos(turn)
    R[:, 0, 2], R[:, 2, 0] = np.sin(turn), -np.sin(turn)
    nod = np.radians(8.0)
    N = np.array([[1, 0, 0], [0, np.cos(nod), -np.sin(nod)], [0, np.sin(nod), np.cos(nod)]])
    return Bust(tensor(R @ N), torch.full((b,), 0.035))


_SEEDS = [  # where each glaze is: entry of the palette, then points in the bust's own frame (x also mirrored)
    (1, [(0.0, 0.80, -0.1), (0.25, 0.70, 0.08), (0.42, 0.42, -0.02), (0.02, 1.0, -0.2), (0.37, 0.12, -0.06)]),
    (0, [(0.0, 0.32, 0.40), (0.02, 0.06, 0.34), (0.20, 0.24, 0.24), (0.05, -0.22, 0.16)]),
    (2, [(0.05, -0.78, 0.25), (0.48, -0.68, 0.1), (0.25, -0.98, 0.2)]),
]


def glazes(bust: Bust) -> Coats:
    """Ivory skin, bronze hair and a blue-green drapery with a worn, stained glaze."""
    b = len(bust.R)
    drawn = draw_coats(rng(4), b, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0, None)
    seeds, entries = [], []
    for entry, points in _SEEDS:
        for x, y, z in points:
            seeds += [(x, y, z), (-x, y, z)]
            entries += [entry] * 2
    own = torch.tensor(seeds)  # (24, 3)
    assert len(own) == SEEDS
    #            base               metal rough spec  tint sheen s.tint coat gloss
    palette = torch.tensor(
        [
            [0.72, 0.57, 0.44, 0.0, 0.38, 0.5, 0.0, 0.0, 0.0, 0.7, 0.55],
            [0.58, 0.37, 0.20, 0.9, 0.36, 0.5, 0.0, 0.0, 0.0, 0.2, 0.60],
            [0.07, 0.31, 0.36, 0.0, 0.42, 0.6, 0.0, 0.0, 0.0, 1.0, 0.75],
            [0.60, 0.50, 0.30, 1.0, 0.40, 0.5, 0.0, 0.0, 0.0, 0.0, 0.00],
        ]
    )
    fields = {f: getattr(drawn, f) for f in drawn.__dataclass_fields__}
    fields |= {
        "pattern": torch.full((b,), 2),
        "palette": palette.expand(b, PALETTE, 11).contiguous(),
        "seeds": own @ bust.R.transpose(1, 2),
        "seed_entry": torch.tensor(entries).expand(b, SEEDS).contiguous(),
        "seed_colours": torch.ones(b, SEEDS, 3),
        "contrast": torch.tensor([[0.13, 0.07, 0.55]]).expand(b, 3).contiguous(),
        "hue": torch.tensor([[1.0, -0.3, -1.0]]).expand(b, 3).contiguous(),
    }
    return Coats(**fields)
