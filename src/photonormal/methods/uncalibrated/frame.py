"""The frame that normals and lights share: photographs of a matt surface are the same after any linear map of both.

I = b.s for scaled normals b and lights s, and so it is for b (1 + E)^-T and s (1 + E). Few things say what E is, to
first order. The normals are a surface's, so their slopes have no curl: A. Yuille, D. Snow, CVPR 1997; that leaves the
generalised bas-relief maps, and is as certain as the parts of the picture agree. And the lights lie near others that
are believed on the whole: given ones, or those that a network gives. Where intensities are unknown, so that a tilt of
all normals changes them alone, an object that is seen whole faces the camera in the mean, its albedo does not follow
its normals (`albedo.py`), and its highlights are those of one material (`highlights.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import normalised

STEP = 1  # pixels over which slopes are compared; over more, edges that hide something behind them spoil more of them
STEEP = 0.2  # z of a normal below which its slopes say nothing
PARTS = 5  # of the object in either direction, whose disagreement shows how certain something is
FEWEST = 100  # pixels that show something
STRAY = 0.7  # medians of what is left, from which on a pixel loses weight
CURL_FLOOR = 0.003  # standard error of the curl itself at least, over the size of what it is made of
CURL_LEAST = 0.01  # of the largest power, the power of the curl that a number makes below which it stays near zero
CURL_NOISE = 6  # exponent of the share that noise has of a turn, by which the variance of what it says grows
CURL_SECOND = 2.0  # and times the square of what it says, which is right to first order only
FACING = 0.1  # standard deviation of x and y of the mean normal of an object that is seen whole
LENGTHS_INDEPENDENT = 2.0  # of the errors of lengths against intensities, most of which shine and interreflections make
ROUNDS = 12  # of reweighting
KEPT = 1e8  # precision with which the map's trace stays: nothing shows the scale of all lights
TRACE = torch.eye(3, dtype=torch.float64).flatten()
BASRELIEF = torch.eye(9, dtype=torch.float64)[[2, 5, 8]]  # entries of E that tilt all normals, and deepen them
TURN = torch.tensor(
    [0, 1, 0, -1, 0, 0, 0, 0, 0], dtype=torch.float64
)  # E of all lights, by a radian about the view axis


@dataclass(frozen=True)
class Believed:
    """Lights that are right on the whole.

    Parameters
    ----------
    lights : (n, 3) unit
    independent : how many of their errors are independent of each other; of given lights all n
    intensities : (n,), up to a factor
    turned : by how much they may all be turned about the view axis, radians, standard deviation
    off : by how much directions are off as a rule, radians, where errors that all share don't show in their scatter
    """

    lights: Float[Tensor, "n 3"]
    independent: float
    intensities: Float[Tensor, " n"]
    turned: float = 0.0
    off: float = 0.0


@dataclass(frozen=True)
class FrameEvidence:
    """`rows` of the nine entries of E, in rows of E, are `told`, with this precision (inverse covariance)."""

    rows: Float[Tensor, "k 9"]
    told: Float[Tensor, " k"]
    precision: Float[Tensor, "k k"]


def settled(
    s: Float[Tensor, "n 3"], believed: Believed, others: Sequence[FrameEvidence | None], share: float = 1.0
) -> Float[Tensor, "n 3"]:
    """The lights s, of any lengths, in the frame that the believed lights and other evidence speak for.

    `share` of the map is applied.
    """
    H = KEPT * TRACE[:, None] * TRACE + torch.eye(9, dtype=torch.float64)
    y = torch.zeros(9, dtype=torch.float64)
    for told in others:
        if told is not None:
            H, y = H + told.rows.T @ told.precision @ told.rows, y + told.rows.T @ told.precision @ told.told
    independent = believed.independent, LENGTHS_INDEPENDENT
    least = max(believed.off**2 / 2, 1e-5), 1e-5  # variance of one number
    E, turn = torch.zeros(9, dtype=torch.float64), 0.0
    for _ in range(ROUNDS):
        P, b = torch.zeros_like(H), torch.zeros_like(y)
        of_lights = [directions(s, believed, turn), lengths(s, believed.intensities)]
        for (J, r, free), m, smallest in zip(of_lights, independent, least, strict=True):
            off = (r - J @ E).square().sum(1)  # (n,)
            w = 1 / (1 + off / (9 * off.median().clamp(min=1e-6)))
            variance = ((w * off).sum() / (free * w.sum() - 8).clamp(min=2)).clamp(min=smallest)
            weight = w / variance * (m / len(s))
            P = P + torch.einsum("nki,n,nkj->ij", J, weight, J)
            b = b + torch.einsum("nki,n,nk->i", J, weight, r)
        PT = P @ TURN
        stiff = 1 + believed.turned**2 * float(TURN @ PT)
        further, back = believed.turned**2 / stiff, turn / stiff  # variance of a further turn; the pull towards none
        E = torch.linalg.solve(H + P - further * torch.outer(PT, PT), y + b - (further * (TURN @ b) + back) * PT)
        turn += further * float(TURN @ (P @ E - b)) - back
    return (s.double() @ (torch.eye(3, dtype=torch.float64) + share * E.reshape(3, 3))).to(s.dtype)


def directions(s: Float[Tensor, "n 3"], believed: Believed, turn: float) -> tuple[Tensor, Tensor, int]:
    """What E changes of the lights' directions (n, 3, 9), by how much they are off (n, 3), of how many numbers each.

    The believed lights are turned by `turn` radians about the view axis first. Both are taken at right angles to them,
    where their errors are shared; to s, where each has its own: those would shorten the mean of the believed lights,
    and move all away from the camera's axis.
    """
    unit, L = normalised(s.double()), believed.lights.double() @ torch.matrix_exp(turn * TURN.reshape(3, 3))
    axis = unit if believed.independent >= len(s) else L
    across = torch.eye(3, dtype=torch.float64) - axis[:, :, None] * axis[:, None, :]  # (n, 3, 3)
    return torch.einsum("nab,nc->nacb", across, unit).flatten(2), (across @ (L - unit)[..., None])[..., 0], 2


def lengths(s: Float[Tensor, "n 3"], e: Float[Tensor, " n"]) -> tuple[Tensor, Tensor, int]:
    """The same of the logarithms of their lengths (n, 1, 9), (n, 1), which are intensities up to a factor."""
    unit = normalised(s.double())
    J = (unit[:, :, None] * unit[:, None, :]).flatten(1)
    r = (e.double() / s.double().norm(dim=1)).log()
    return (J - J.mean(0))[:, None], (r - r.mean())[:, None], 1


def of_curl() -> Float[Tensor, "5 9"]:
    """From the entries of E to the five numbers of the normals' map D = -E^T that their curl shows."""
    D = torch.zeros(5, 3, 3, dtype=torch.float64)  # D[i, k] is -E[k, i]
    for row, (i, k) in enumerate(((1, 0), (1, 2), (0, 1), (0, 2))):
        D[row, k, i] = -1
    D[4, 0, 0], D[4, 1, 1] = -1, 1
    return D.flatten(1)


class CurlResidual(NamedTuple):
    """Of q pixels: `r`, the curl that is left; `J`, what the five numbers take away; its weight; where."""

    J: Float[Tensor, "q 5"]
    r: Float[Tensor, " q"]
    weight: Float[Tensor, " q"]
    whole: Bool[Tensor, "i j"]

    def power(self) -> Float[Tensor, "5 5"]:
        """How much curl the five numbers make, mean squares and products over the size of what it is made of.

        On a low relief those by which all lights tilt make little, by the slopes' square: what is small beside the
        slopes' changes, noise, shine and shadows, would pass for them.
        """
        J = self.J * self.weight[:, None]
        return J.T @ J / len(J) + 1e-9 * torch.eye(5, dtype=torch.float64)


def curl(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> FrameEvidence | None:
    """What (1 + D), D[1, 0], D[1, 2], D[0, 1], D[0, 2], D[0, 0] - D[1, 1], takes the curl of N's slopes away.

    None where too few normals have neighbours. Curl that is left is the normals' noise, which what turns them holds as
    well: it passes for a turn. Where it is as large as what a turn by a radian makes, nothing is known.
    """
    told = curl_of(N, inside)
    if told is None:
        return None
    theta, covariance = fitted(told.J, told.r, told.weight, part_of(told.whole), CURL_LEAST)
    power, left = told.power(), told.weight * (told.r - told.J @ theta)
    noise = (1.4826 * left.abs().median()) ** 2 / power.diagonal()[[0, 2]].min()
    covariance = covariance + CURL_FLOOR**2 * torch.linalg.inv(power)
    covariance = covariance + ((CURL_SECOND * theta**2).square() + noise**CURL_NOISE).diag()
    return FrameEvidence(of_curl(), theta, torch.linalg.inv(covariance))


def curl_of(N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]) -> CurlResidual | None:
    """The curl of N's slopes, to first order in the map's five numbers; None where too few normals have neighbours."""
    map = as_grid(N.double(), inside)
    there = map[..., 2] > STEEP
    k = STEP
    sides = [(slice(k, -k), slice(None, -2 * k)), (slice(k, -k), slice(2 * k, None))]
    sides += [(columns, rows) for rows, columns in sides]
    left, right, above, below = (map[side] for side in sides)
    whole = there[k:-k, k:-k] & torch.stack([as_grid(N.norm(dim=1), inside)[side] > 0.5 for side in sides]).all(0)
    if int(whole.sum()) < FEWEST:
        return None
    b = map[k:-k, k:-k][whole]
    z2 = b[:, 2:].square()
    X = torch.linalg.cross(b, ((right - left) / (2 * k))[whole]) / z2  # b x db/dx over b_z^2, whose y is -dq/dx
    Y = torch.linalg.cross(b, ((above - below) / (2 * k))[whole]) / z2
    J = torch.stack([-Y[:, 0], -Y[:, 2], -X[:, 1], -X[:, 2], (Y[:, 1] - X[:, 0]) / 2], dim=1)  # (q, 5)
    size = 1e-3 + X.norm(dim=1) + Y.norm(dim=1)
    return CurlResidual(J, -(Y[:, 1] + X[:, 0]), 1 / size, whole)


def facing(N: Float[Tensor, "p 3"]) -> FrameEvidence:
    """An object that is seen whole faces the camera in the mean: what E[0, 2] and E[1, 2] turn its mean normal there.

    These two tilt all normals and make lights on one side brighter, which nothing else shows where intensities are
    unknown.
    """
    x, y, z = N.double().mean(0)
    rows = torch.eye(9, dtype=torch.float64)[[2, 5]]
    return FrameEvidence(rows, torch.stack([x, y]) / z, torch.eye(2, dtype=torch.float64) / (FACING / z) ** 2)


def fitted(
    J: Float[Tensor, "q k"], r: Float[Tensor, " q"], weight: Float[Tensor, " q"], part: Tensor, least: float = 0.0
) -> tuple[Float[Tensor, " k"], Float[Tensor, "k k"]]:
    """argmin sum_q -1 / (1 + (weight (r - J theta))_q^2 / spread^2), spread from a median: edges, where a surface has
    no slopes and paint another colour, don't count. Its covariance by how much the parts disagree.

    A number on which the sum depends less than `least` times as much as on the one that counts most stays near zero.
    """
    eye = torch.eye(J.shape[1], dtype=torch.float64)
    theta = torch.zeros(J.shape[1], dtype=torch.float64)
    v, H = weight, eye
    for _ in range(ROUNDS):
        off = weight * (r - J @ theta)
        v = (weight / (1 + (off / (STRAY * off.abs().median().clamp(min=1e-9))) ** 2)) ** 2
        H = (J * v[:, None]).T @ J
        H = H + (1e-9 + least * H.diagonal().max()) * eye
        theta = torch.linalg.solve(H, (J * v[:, None]).T @ r)
    pull = torch.zeros(PARTS**2, J.shape[1], dtype=torch.float64)
    pull.index_add_(0, part, J * (v * (r - J @ theta))[:, None])
    inverse = torch.linalg.inv(H)
    return theta, inverse @ (pull.T @ pull) @ inverse


def as_grid(values: Tensor, inside: Bool[Tensor, "h w"]) -> Tensor:
    """Values (p, ...) at the pixels inside as a map (h, w, ...), zero elsewhere."""
    map = values.new_zeros(*inside.shape, *values.shape[1:])
    map[inside] = values
    return map


def part_of(some: Bool[Tensor, "h w"]) -> Tensor:
    """Which of PARTS x PARTS parts of the picture each of some pixels lies in."""
    rows, columns = some.nonzero().T
    return (rows * PARTS // some.shape[0]) * PARTS + columns * PARTS // some.shape[1]
