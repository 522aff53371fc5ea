"""Pictures that are clearly brighter or darker than the intensities of their lights say, as of a flash that was not
charged: they are divided by that factor, which the object's own shading shows.

Semi-calibrated photometric stereo (D. Cho, Y. Matsushita, Y.-W. Tai, I. Kweon, ECCV 2016), robust: normals n and albedo
rho from the pictures over the factors e, then e_j = median over pixels of I_pj / (rho_p n_p.l_j), in turn. A factor
changes a picture wherever the surface points; shine, shadows and bounced light do so in places, and most lights are as
given. Where that is in doubt nothing is changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.calibration.intensities import linear_intensities
from photonormal.methods.contract import Observations
from photonormal.methods.uncalibrated.rounds import albedo, normals_under
from photonormal.methods.uncalibrated.shown import ShownPixels
from photonormal.resources import by_one_thread
from photonormal.shading import cosines, normalised

LEAST = 8  # lights
ROUNDS, AGREE = 8, 0.003  # and change of the factors' logarithms, after which they have settled
FACING = 0.2  # cosine from which on a sample shows its light's factor
OFF, SPREADS = 0.1, 4.0  # logarithm of a factor, and in spreads of all lights', from which on it counts
MOST, SHARE = 0.8, 0.4  # logarithm, and share of the lights: beyond, something else is wrong
STRAY = 0.2  # logarithm of a sample over its shading, up to which it counts as misfit
MATT = 0.06  # misfit beyond which shading doesn't explain the object
BETTER, OTHER = 0.9, 0.95  # of the misfit is left at most with the factors; from another start, which is taken then
CLEAR = 2.0  # deviations of a picture's samples that its factor has at least
PLACES, TURNS = 3, 3  # parts of the object along each side, and by the angle to where a mirror would show the light
OF_PART, PARTS = 30, 5  # samples that show in a part, and parts that have so many
SHARED = 0.5  # of the factor's logarithm, that each of these parts shows at least


@by_one_thread()
def brightened(seen: Observations) -> Float[Tensor, " n"]:
    """Factors by which pictures are brighter than their lights' intensities say, 1 where that is not clear.

    `seen` are some pixels of the object under distant lights.
    """
    L = seen.lights.float()
    assert seen.mask is not None
    shown = ShownPixels(seen.I, seen.keep, seen.mask, seen.I.mean(0)[:, None])
    return (off(shown, L) if len(L) >= LEAST else torch.zeros(len(L))).exp()


def off(shown: ShownPixels, L: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Logarithms of the lights' factors, 0 where they are not clear."""
    none = torch.zeros(len(L))
    enough = shown.keep.sum(1) > 3
    if enough.sum() < OF_PART * PARTS:
        return none
    linear = linear_intensities(shown.I[enough].double().numpy(), L.double().numpy())
    log_e, other = (settled(shown, L, start) for start in (none, torch.from_numpy(linear).float().log()))
    if FactorResidual.of(shown, L, other).misfit < OTHER * FactorResidual.of(shown, L, log_e).misfit:
        log_e = other  # lights beside each other that are off alike explain each other, by wrong normals
    log_e = log_e - log_e.median()
    clear = log_e.abs() > max(OFF, SPREADS * 1.4826 * float(log_e.abs().median()))
    if not clear.any() or clear.float().mean() > SHARE or log_e.abs().max() > MOST:
        return none
    log_e = torch.where(clear, FactorResidual.of(shown, L, none, ~clear).told, 0)
    after = FactorResidual.of(shown, L, log_e, ~clear)
    if after.misfit > min(MATT, BETTER * FactorResidual.of(shown, L, none).misfit):
        return none
    for j in clear.nonzero()[:, 0].tolist():
        clear[j] = after.shares(j, float(log_e[j]), shown)
    return torch.where(clear, log_e, 0)


def settled(shown: ShownPixels, L: Float[Tensor, "n 3"], log_e: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Factors and normals that agree, from these factors on."""
    for _ in range(ROUNDS):
        change = FactorResidual.of(shown, L, log_e).told
        change = change - change.median()
        log_e = log_e + change
        if change.abs().max() < AGREE:
            break
    return log_e


@dataclass(frozen=True)
class FactorResidual:
    """What shading leaves of pictures over the factors of their lights.

    Parameters
    ----------
    q : (p, n) log I / (e rho n.l) where a sample shows its light's factor; nan elsewhere
    aside : (p, n) cosine of the normal's angle to where a mirror would show the light
    """

    q: Float[Tensor, "p n"]
    aside: Float[Tensor, "p n"]

    @classmethod
    def of(
        cls,
        shown: ShownPixels,
        L: Float[Tensor, "n 3"],
        log_e: Float[Tensor, " n"],
        by: Bool[Tensor, " n"] | None = None,
    ) -> FactorResidual:
        """By normals and albedo that a robust classical method finds, of all pictures or `by` those of some lights."""
        shown = shown.over(log_e.exp())
        some = shown if by is None else replace(shown, keep=shown.keep & by)
        N = normals_under(some, L)
        rho, shading = albedo(some, N, L)[:, None], cosines(N, L)
        tells = shown.keep & (shading > FACING) & (rho > 0)
        q = torch.where(tells, (shown.I / (rho * shading)).clamp(min=1e-6).log(), torch.nan)
        return cls(q, cosines(N, normalised(L + L.new_tensor([0, 0, 1]))))

    @property
    def told(self) -> Float[Tensor, " n"]:
        """By what each picture is brighter, as a logarithm."""
        return self.q.nanmedian(0).values.nan_to_num(0)

    @property
    def misfit(self) -> float:
        """The mean of what is left."""
        return float(self.q.abs().clamp(max=STRAY).nanmean())

    def shares(self, j: int, log_e: float, shown: ShownPixels) -> bool:
        """Whether all parts of the object, by place and by orientation, show much the same factor of light j."""
        tells = self.q[:, j].isfinite()
        left = self.q[tells, j]
        if len(left) < OF_PART or CLEAR * left.abs().median() > abs(log_e):
            return False
        at = shown.inside.nonzero()[tells].float()
        at = at - at.amin(0)
        place = (PLACES * at / (at.amax(0) + 1)).long() @ torch.tensor([1, PLACES])
        aside = self.aside[tells, j]
        turn = torch.bucketize(aside, aside.quantile(torch.arange(1, TURNS) / TURNS))
        parts = [left[place == k] for k in range(PLACES**2)] + [left[turn == k] for k in range(TURNS)]
        of_parts = [1 + float(part.median()) / log_e for part in parts if len(part) >= OF_PART]
        return len(of_parts) >= PARTS and min(of_parts) > SHARED
