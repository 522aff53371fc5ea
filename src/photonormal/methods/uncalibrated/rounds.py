"""Lights and normals that explain each other: each is found from the other in turn, until they agree."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.methods.classical.l1 import L1
from photonormal.methods.classical.trimmed import Trimmed
from photonormal.methods.uncalibrated.albedo import unshaded
from photonormal.methods.uncalibrated.frame import Believed, curl, facing, settled
from photonormal.methods.uncalibrated.highlights import highlights
from photonormal.methods.uncalibrated.shown import ShownPixels
from photonormal.resources import by_one_thread
from photonormal.shading import angle_deg, cosines, normalised

SPREAD = 0.1  # of a sample over its albedo, beyond which it loses weight: a highlight, or a shadow
GRAZING = 0.05  # cosine below which a light shows nothing of itself at a pixel
FAR = 10.0  # factor by which a light is brighter or darker than most, from which on its pixels don't show it
TIED = 1e-3  # weight of a light as it was, over that of all samples
MANY = 16  # lights, of whose samples some can be left out, so that albedo is free of shine
ROUNDS = 20
DAMPED = 0.6  # share of the frame's map that is applied in a round where it may be large: lights unknown
AGREE_DEG = 0.05  # mean change of the lights in a round, after which they have settled
SETTLED_DEG = 0.6  # and from which on, in the last round, lights and normals contradict each other
REWEIGHTED = 6


@by_one_thread()
def rounds(
    shown: ShownPixels, L: Float[Tensor, "n 3"], believed: Believed, unknown: bool = False
) -> tuple[Tensor, Tensor, float]:
    """Lights s (n, 3) with their intensities as lengths, normals (p, 3), and the last mean change in degrees.

    `L` are the lights to start from, with their intensities as lengths, which the pictures still have in them.
    `unknown`: so are the intensities, and the object is seen whole; else the pictures are free of intensities.
    """
    s, moved = L, float("inf")
    N = torch.zeros(len(shown.I), 3)
    for _ in range(ROUNDS):
        N = normals_under(shown, s)
        before, s = normalised(s), lights_of(shown, N, s)
        others = [curl(N, shown.inside)]
        if unknown:
            others += [facing(N), highlights(shown, N, s)]
        if unknown and len(s) >= MANY:
            others += [unshaded(albedo(shown, N, s), N, shown.inside, len(s))]
        s = settled(s, believed, others, DAMPED if unknown else 1.0)
        s = s / s.norm(dim=1).mean()
        moved = float(angle_deg(before, normalised(s)).mean())
        if moved < AGREE_DEG:
            break
    return s, N, moved


def normals_under(shown: ShownPixels, s: Float[Tensor, "n 3"]) -> Float[Tensor, "p 3"]:
    """Unit normals by a robust classical method; many lights leave room for trimming."""
    method = Trimmed() if len(s) >= MANY else L1()
    return method.fit(shown.I / s.norm(dim=1), shown.keep, normalised(s))


def albedo(shown: ShownPixels, N: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> Float[Tensor, " p"]:
    """A median over each pixel's lit samples; 0 where there is none."""
    shading = cosines(N, s)  # (p, n)
    seen = shown.keep & (shading > GRAZING)
    rho = torch.where(seen, shown.I / shading.clamp(min=GRAZING), torch.nan).nanmedian(1).values
    return rho.nan_to_num(0) * (N.norm(dim=1) > 0.5)


def over_albedo(shown: ShownPixels, N: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> tuple[Tensor, Tensor]:
    """The samples (p, n) over their pixel's albedo, and which pixels (p, 1) have one."""
    rho = albedo(shown, N, s)[:, None]
    return torch.where(rho > 0, shown.I / torch.where(rho > 0, rho, 1), 0), rho > 0


def misfit(shown: ShownPixels, N: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> float:
    """Median over lit samples of |I / rho - n.s|: what matt shading leaves unexplained."""
    I, known = over_albedo(shown, N, s)
    off = (I - cosines(N, s).clamp(min=0)).abs()[shown.keep & known]
    return float(off.median()) if off.numel() else float("inf")


def lights_of(shown: ShownPixels, N: Float[Tensor, "p 3"], s: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    """argmin over s_j of sum_p log(1 + (I_pj / rho_p - n_p.s_j)^2 / SPREAD^2), over lit samples, from the lights s.

    What no pixel shows of a light stays as it is in s: all of it, or its part along a cylinder.
    """
    I, known = over_albedo(shown, N, s)
    NN = (N[:, :, None] * N[:, None, :]).flatten(1)  # (p, 9)
    for _ in range(REWEIGHTED):
        shading = cosines(N, s)
        spread = SPREAD * s.norm(dim=1)
        w = (shown.keep & known & (shading > GRAZING)) / (1 + ((I - shading) / spread) ** 2)
        tied = TIED * (1 + w.sum(0))[:, None]  # (n, 1)
        A = (w.T @ NN).unflatten(1, (3, 3)) + tied[..., None] * torch.eye(3)
        y = (w * I).T @ N + tied * s
        found = torch.linalg.solve(A, y)
        length = found.norm(dim=1, keepdim=True)
        usual = (length > length.median() / FAR) & (length < length.median() * FAR)  # nan is not
        s = torch.where(usual, found, s)  # a light that nothing shows of stays
    return s
