"""Highlights show how tilted a surface is, which matt shading leaves open.

Of an isotropic material, the brightness over a matt surface's is the same function of the angle between the normal and
the direction halfway to the light, wherever on the object (after O. Drbohlav, R. Sara, ECCV 2002). In a wrong frame
(`frame.py`) the highlights of different lights are at different angles.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.methods.uncalibrated.frame import BASRELIEF, PARTS, FrameEvidence, part_of
from photonormal.methods.uncalibrated.shown import ShownPixels
from photonormal.shading import cosines, normalised

PIXELS = 600  # that are looked at
GRAZING = 0.3  # cosine below which a sample is dark more by its surroundings than by its material
ANGLES_DEG = (0, 4, 8, 12, 17, 23, 30, 38, 48, 60, 90)  # between which the brightness is linear
STRAY = 0.3  # of the logarithm of a sample, from which on it loses weight
DARK = 1e-4  # of the mean sample, the least whose logarithm is taken
STEP = 0.02  # of the map's entries, over which samples' changes are taken
GAIN = (2.0, 2.0, 3.0)  # times what one linear step shows, half of which and less is found on rendered objects
NOISE = 0.3  # standard error of the logarithms, as if each part of what changes them were one sample
FLOOR = (0.03, 0.03, 0.3)  # least standard error; depth is found badly, since normals were found without them
MOST = 0.5  # of the map, that is changed at once
ROUNDS = 4  # of reweighting


class LogExcess(NamedTuple):
    """Logarithms of samples over a matt surface's (p, n), and by what they may differ (p, n, k)."""

    y: Float[Tensor, "p n"]
    B: Float[Tensor, "p n k"]


def highlights(shown: ShownPixels, N: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> FrameEvidence | None:
    """What E[0, 2], E[1, 2] and E[2, 2] make brightness the same function of the angle to a highlight's middle.

    `N` are unit normals, `s` lights with their intensities as lengths. None where too few normals are known.
    """
    known = (N.norm(dim=1) > 0.5).nonzero()[:, 0]
    if len(known) < PIXELS // 4:
        return None
    some = known[torch.linspace(0, len(known) - 1, min(PIXELS, len(known))).long()]
    I, n, s = shown.I[some].double(), N[some].double(), s.double()
    log = I.clamp(min=DARK * float(I.mean())).log()
    shading = cosines(n, normalised(s))
    lit = (shown.keep[some] & (shading > GRAZING)) * shading
    here = compared(log, n, s)
    w, c = lit, here.B.new_zeros(here.B.shape[2])
    for _ in range(ROUNDS):
        c = explaining(centred(here.B, w), centred(here.y, w)[..., None], w)[:, 0]
        w = lit / (1 + (centred(here.y - here.B @ c, w) / STRAY) ** 2) ** 2
    changes = []
    for E in BASRELIEF:
        more, less = (compared(log, *mapped(n, s, by * E.reshape(3, 3))) for by in (STEP, -STEP))
        changes.append(((more.y - less.y) - (more.B - less.B) @ c) / (2 * STEP))
    B, r = centred(here.B, w), centred(here.y - here.B @ c, w)
    J = centred(torch.stack(changes, dim=-1), w)  # (p, n, 3)
    J = J - B @ explaining(B, J, w)
    pull = torch.zeros(PARTS**2, 3, dtype=J.dtype)
    pull.index_add_(0, part_of(shown.inside)[some], -(J * (w * r)[..., None]).sum(1))
    A = flat(w[..., None] * J).T @ flat(J)
    inverse = torch.linalg.inv(A + ridge(A, 1e-6)) * A.new_tensor(GAIN)
    told = pull.sum(0) @ inverse
    covariance = inverse.T @ (pull.T @ pull + NOISE**2 * A) @ inverse + A.new_tensor(FLOOR).square().diag()
    return FrameEvidence(BASRELIEF, told * (MOST / told.norm()).clamp(max=1), torch.linalg.inv(covariance))


def compared(log: Float[Tensor, "p n"], n: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> LogExcess:
    """Samples over those of a matt surface, and what they are to follow: the angle to the halfway vector, how grazing
    the light is, and how far it is from the camera's axis."""
    l = normalised(s)
    halfway = normalised(l + l.new_tensor([0.0, 0.0, 1.0]))
    shading = cosines(n, l).clamp(min=0.03)
    angle = cosines(n, halfway).clamp(-1 + 1e-9, 1 - 1e-9).acos().rad2deg()
    ends = angle.new_tensor(ANGLES_DEG)
    k = torch.bucketize(angle, ends[1:-1])
    share = (angle - ends[k]) / (ends[k + 1] - ends[k])
    B = angle.new_zeros(*angle.shape, len(ends) + 1)
    B.scatter_(2, k[..., None], (1 - share)[..., None]).scatter_(2, k[..., None] + 1, share[..., None])
    B[..., -2], B[..., -1] = shading.log(), 1 - (l * halfway).sum(1)
    return LogExcess(log - (s.norm(dim=1) * shading).log(), B)


def explaining(B: Float[Tensor, "p n k"], y: Float[Tensor, "p n m"], w: Float[Tensor, "p n"]) -> Float[Tensor, "k m"]:
    """argmin over c of sum w (y - B c)^2."""
    WB = flat(w[..., None] * B)
    A = WB.T @ flat(B)
    return torch.linalg.solve(A + ridge(A, 1e-4), WB.T @ flat(y))


def ridge(A: Float[Tensor, "k k"], share: float) -> Float[Tensor, "k k"]:
    """A share of the mean of A's diagonal, so that what nothing shows has a solution."""
    return (share * A.diagonal().mean() + 1e-12) * torch.eye(len(A), dtype=A.dtype)


def mapped(n: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"], E: Float[Tensor, "3 3"]) -> tuple[Tensor, Tensor]:
    """Normals and lights after the map 1 + E."""
    A = torch.eye(3, dtype=n.dtype) + E
    return normalised(n @ torch.linalg.inv(A).T), s @ A


def centred(values: Float[Tensor, "p n *k"], w: Float[Tensor, "p n"]) -> Float[Tensor, "p n *k"]:
    """Values without each pixel's mean, which is its albedo's."""
    w = w.reshape(*w.shape, *[1] * (values.ndim - 2))
    return values - (w * values).sum(1, keepdim=True) / w.sum(1, keepdim=True).clamp(min=1e-9)


def flat(values: Float[Tensor, "p n k"]) -> Float[Tensor, "q k"]:
    """All samples one after the other."""
    return values.flatten(0, 1)
