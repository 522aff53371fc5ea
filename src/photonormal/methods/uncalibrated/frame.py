"""The frame that normals and lights share: photographs of a matt surface are the same after any linear map of both.

I = b.s for scaled normals b and lights s, and so it is for b A^-T and s A. A is told by two things. The normals are a
surface's, so their slopes have no curl: A. Yuille, D. Snow, CVPR 1997; that leaves the generalised bas-relief maps.
And the lights lie near others that are believed on the whole: given ones, or those that a network tells.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.shading import normalised

STEP = 3  # pixels over which slopes are compared
STEEP = 0.2  # z of a normal below which its slopes say nothing
PARTS = 5  # of the object in either direction, whose disagreement tells how certain the curl is
CURL_FLOOR = 0.015  # least standard error of what the curl says
ROUNDS = 12  # of reweighting
KEPT = 1e8  # precision with which the map's trace stays: nothing tells the scale of all lights
TRACE = torch.eye(3, dtype=torch.float64).flatten()


@dataclass(frozen=True)
class Believed:
    """Lights that are right on the whole.

    Parameters
    ----------
    lights : (n, 3) unit
    independent : how many of their errors are independent of each other; of given lights all n
    """

    lights: Float[Tensor, "n 3"]
    independent: float


def settled(
    s: Float[Tensor, "n 3"], N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"], believed: Believed
) -> Float[Tensor, "n 3"]:
    """The lights s, of any lengths, in the frame that the normals' curl and the believed lights speak for."""
    A = torch.eye(3, dtype=torch.float64)
    slopes = curl(N, inside)
    unit, L = normalised(s.double()), believed.lights.double()
    across = torch.eye(3, dtype=torch.float64) - L[:, :, None] * L[:, None, :]  # (n, 3, 3): at right angles to each
    J = torch.einsum("jab,jc->jacb", across, unit).reshape(-1, 9)  # of the angles, by the entries of E in s (1 + E)
    r = (across @ (L - unit)[..., None]).reshape(-1)
    w = torch.ones(len(L), dtype=torch.float64)
    E = torch.zeros(9, dtype=torch.float64)
    for _ in range(ROUNDS):
        off = (r - J @ E).unflatten(0, (-1, 3)).square().sum(1)
        variance = ((w * off).sum() / (2 * w.sum() - 8).clamp(min=2)).clamp(min=1e-5)
        weight = w.repeat_interleave(3) / variance * (believed.independent / len(L))
        H = (J * weight[:, None]).T @ J + KEPT * TRACE[:, None] * TRACE + torch.eye(9, dtype=torch.float64)
        y = (J * weight[:, None]).T @ r
        if slopes is not None:
            theta, precision = slopes
            H, y = H + CURL_OF.T @ precision @ CURL_OF, y + CURL_OF.T @ precision @ theta
        E = torch.linalg.solve(H, y)
        w = 1 / (1 + off / (9 * off.median().clamp(min=1e-6)))
    return (s.double() @ (A + E.reshape(3, 3))).to(s.dtype)


def curl_of() -> Float[Tensor, "5 9"]:
    """From the entries of E, the map of the lights, to the five numbers of the normals' map -E^T that curl tells."""
    D = torch.zeros(5, 3, 3, dtype=torch.float64)  # entry (i, k) of the normals' map is -E[k, i]
    for row, (i, k) in enumerate(((1, 0), (1, 2), (0, 1), (0, 2))):
        D[row, k, i] = -1
    D[4, 0, 0], D[4, 1, 1] = -1, 1
    return D.flatten(1)


CURL_OF = curl_of()


def curl(
    N: Float[Tensor, "p 3"], inside: Bool[Tensor, "h w"]
) -> tuple[Float[Tensor, " 5"], Float[Tensor, "5 5"]] | None:
    """What (1 + D), D[1, 0], D[1, 2], D[0, 1], D[0, 2], D[0, 0] - D[1, 1], takes the curl away; and its precision.

    None where too few normals have neighbours.
    """
    h, w = inside.shape
    map = torch.zeros(h, w, 3, dtype=torch.float64)
    map[inside] = N.double()
    there = map.norm(dim=-1) > 0.5
    k = STEP
    middle, whole = inner(map, k), inner(there, k)
    left, right, above, below = map[k:-k, : -2 * k], map[k:-k, 2 * k :], map[: -2 * k, k:-k], map[2 * k :, k:-k]
    for v in (there[k:-k, : -2 * k], there[k:-k, 2 * k :], there[: -2 * k, k:-k], there[2 * k :, k:-k]):
        whole = whole & v
    whole = whole & (middle[..., 2] > STEEP)
    if int(whole.sum()) < 20 * PARTS:
        return None
    b = middle[whole]
    z2 = b[:, 2:].square()
    X = torch.linalg.cross(b, ((right - left) / (2 * k))[whole]) / z2  # b x db/dx over b_z^2, whose y is -dq/dx
    Y = torch.linalg.cross(b, ((above - below) / (2 * k))[whole]) / z2
    J = torch.stack([-Y[:, 0], -Y[:, 2], -X[:, 1], -X[:, 2], (Y[:, 1] - X[:, 0]) / 2], dim=1)  # (q, 5)
    r = -(Y[:, 1] + X[:, 0])
    size = 1e-3 + X.norm(dim=1) + Y.norm(dim=1)
    theta = torch.zeros(5, dtype=torch.float64)
    eye = 1e-9 * torch.eye(5, dtype=torch.float64)
    for _ in range(ROUNDS):
        off = r - J @ theta
        v = 1 / (1 + (off / (1.5 * off.abs().median().clamp(min=1e-9))) ** 2) / size
        H = (J * v[:, None]).T @ J
        theta = torch.linalg.solve(H + eye, (J * v[:, None]).T @ r)
    rows, columns = whole.nonzero().T
    side = max(1, -(-max(h, w) // PARTS))
    part = torch.unique((rows // side) * PARTS + columns // side, return_inverse=True)[1]
    pull = torch.zeros(int(part.max()) + 1, 5, dtype=torch.float64)
    pull.index_add_(0, part, J * (v * (r - J @ theta))[:, None])  # pyright: ignore[reportPossiblyUnboundVariable]
    inverse = torch.linalg.inv(H + eye)  # pyright: ignore[reportPossiblyUnboundVariable]
    covariance = inverse @ (pull.T @ pull) @ inverse + CURL_FLOOR**2 * torch.eye(5, dtype=torch.float64)
    return theta, torch.linalg.inv(covariance)


def inner(x: Tensor, k: int) -> Tensor:
    """Without k rows and columns at each edge."""
    return x[k:-k, k:-k]
