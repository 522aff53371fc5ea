"""Light between parts of the surface; where rays from a pixel arrive is found once for all lights."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.synth.params import indices
from photonormal.synth.trace import NOWHERE

RAYS = 12  # from each pixel
FACING = 32  # exponent of the cosine between two pixels' normals that weighs what one has gathered for the other
GLOSS = 12  # exponent of the lobe that one half of them follows
STEPS = 24


def rays(N: Float[Tensor, "b q 3"], seed: int) -> tuple[Float[Tensor, "b q m 3"], Float[Tensor, "b q m"]]:
    """RAYS directions from each normal, and pi times the density there.

    One half spreads around the normal with the cosine, the other around the mirror image of the view, where gloss shows
    the camera what it reflects; both are stratified, each pixel's at random.
    """
    b, q, _ = N.shape
    i = torch.arange(RAYS // 2, device=N.device)
    chance = torch.rand((2, b, q, 1), generator=torch.Generator().manual_seed(seed)).to(N.device)
    k = (i + chance[0]) / (RAYS // 2)  # (b, q, m / 2)
    phi, turn = i * (math.pi * (1 + 5**0.5)), chance[1] * (2 * math.pi)
    mirror = 2 * N[..., 2:] * N - N.new_tensor([0.0, 0.0, 1.0])
    d = torch.cat([_lobe(N, k.sqrt(), phi + turn), _lobe(mirror, k ** (1 / (GLOSS + 1)), phi - turn)], 2)
    gloss = (GLOSS + 1) / 2 * (d @ mirror[..., None])[..., 0].clamp(min=0) ** GLOSS
    return d, ((d @ N[..., None])[..., 0].clamp(min=0) + gloss) / 2


def _lobe(axis: Float[Tensor, "b q 3"], w: Tensor, phi: Tensor) -> Float[Tensor, "b q m 3"]:
    """Unit vectors at the cosine `w` from an axis, at the angle `phi` about it."""
    x, y, z = (c[..., None] for c in axis.unbind(-1))
    z = z.clamp(min=-0.99)
    a = -1 / (1 + z)  # Duff et al., JCGT 2017: a tangent frame without a square root
    c = x * y * a
    t1 = torch.cat([1 + x * x * a, c, -x], -1)[:, :, None]
    t2 = torch.cat([c, 1 + y * y * a, -y], -1)[:, :, None]
    radius = (1 - w**2).sqrt()
    u, v = radius * torch.cos(phi), radius * torch.sin(phi)
    return u[..., None] * t1 + v[..., None] * t2 + w[..., None] * axis[:, :, None]


def hits(
    height: Float[Tensor, "b s s"],
    behind: Float[Tensor, "b s s"],
    normals: Float[Tensor, "b 3 s s"],
    on: Bool[Tensor, "b q"],
    directions: Float[Tensor, "b q m 3"],
) -> Int[Tensor, "b q m"]:
    """Pixel that each ray meets first; -1 where it meets none, begins below the surface or at a pixel that is not `on`.

    The height field is marched in steps that grow with distance. A ray that passes below where the view leaves the
    solid (`behind`, a height, too) passes behind it and goes on; one that arrives at a visible point from behind is
    stopped, and sees nothing that is lit.
    """
    b, s, _ = height.shape
    device, m = height.device, directions.shape[2]
    pixel = indices(on)  # (b, r)
    N = normals.flatten(2).gather(2, pixel[:, None].expand(-1, 3, -1)).transpose(1, 2)  # (b, r, 3)
    d = directions.gather(1, pixel[..., None, None].expand(-1, -1, m, 3))  # (b, r, m, 3)
    dx, dy, dz = d[..., 0], -d[..., 1], d[..., 2]
    x, y, z = N[..., None].unbind(2)  # rays begin one pixel off the surface, at (col, row, z) in a frame one wider
    col, row = (pixel % s)[..., None] + 1.5 + x, (pixel // s)[..., None] + 1.5 - y
    z = height.flatten(1).gather(1, pixel)[..., None] + z
    wide = s + 2
    solid = F.pad(torch.complex(height, behind), (1, 1, 1, 1), value=NOWHERE).flatten()  # both in one look
    scene = torch.arange(b, device=device, dtype=torch.int32).view(b, 1, 1) * (wide * wide)
    end = torch.full(d.shape[:3], -1.0, device=device)  # length of each ray
    open = on.gather(1, pixel)[..., None] & ((d @ N[..., None])[..., 0] > 0)
    before = torch.full_like(end, -1.0)
    reach = torch.cumsum((s / 12) ** torch.linspace(0, 1, STEPS), 0)
    reach = reach * (1.2 * s / reach[-1])

    def at(t: float | Tensor) -> Tensor:
        c = (col + t * dx).clamp_(0, wide - 1).to(torch.int32)
        return (row + t * dy).clamp_(0, wide - 1).to(torch.int32).mul_(wide).add_(c)

    for t, dt in zip(reach.tolist(), torch.diff(reach, prepend=torch.zeros(1)).tolist(), strict=True):
        there = solid.index_select(0, (at(t) + scene).flatten()).view_as(end)
        level = z + t * dz
        depth = there.real - level
        entered = open & (depth > 0) & (there.imag < level + dt)
        arrived = t - dt * depth / (depth - before.clamp(max=-1e-3)).clamp(min=1e-3)
        end = torch.where(entered & (before <= 0), arrived, end)
        open = open & ~entered
        before = depth
    last = at(end)
    last = (last // wide - 1).clamp(0, s - 1) * s + (last % wide - 1).clamp(0, s - 1)
    met = normals.flatten(2).transpose(1, 2).flatten(0, 1)  # (b s s, 3)
    scene = torch.arange(b, device=device).view(b, 1, 1) * (s * s)
    front = (met.index_select(0, (last + scene).flatten()).view_as(d) * d).sum(-1) < 0
    last = torch.where((end >= 0) & front, last, -1)
    none = torch.full((b, on.shape[1], m), -1, dtype=torch.int32, device=device)
    return none.scatter(1, pixel[..., None].expand_as(last), last)


def gather(rows: Float[Tensor, "b r k"], row: Int[Tensor, "b q m"]) -> Float[Tensor, "b q k"]:
    """Sum of what arrives along a pixel's rays: of the rows that `row` names, -1 for none."""
    b, r, k = rows.shape
    index = torch.where(row >= 0, row + torch.arange(b, device=row.device).view(b, 1, 1) * r, b * r).flatten(0, 1)
    table = torch.cat([rows.flatten(0, 1), rows.new_zeros(1, k)])
    return F.embedding_bag(index, table, mode="sum", padding_idx=b * r).view(b, -1, k)


def around(
    on: Bool[Tensor, "b q"], normals: Float[Tensor, "b q 3"], pixel: Int[Tensor, "b p"]
) -> tuple[Int[Tensor, "bp 9"], Float[Tensor, "bp 9"]]:
    """Each pixel and its neighbours, all of them `on`, and their weights: large where they face the same way."""
    b, q = on.shape
    size = math.isqrt(q)
    first = torch.arange(b, device=pixel.device).view(b, 1) * q
    flat, on = normals.reshape(-1, 3), on.reshape(-1)
    own = flat[pixel + first]
    row, column = pixel // size, pixel % size
    taps, weights = [], []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            y, x = row + down, column + right
            inside = (y >= 0) & (y < size) & (x >= 0) & (x < size)
            tap = torch.where(inside, y * size + x, pixel).long() + first
            same = (flat[tap] * own).sum(-1).clamp(min=0.05)
            weights.append(same**FACING * (on[tap] & inside))
            taps.append(tap)
    weight = torch.stack(weights, -1)
    weight = weight / weight.sum(-1, keepdim=True).clamp(min=1e-6)
    return torch.stack(taps, -1).flatten(0, 1), weight.flatten(0, 1)


def spread(
    values: Float[Tensor, "b q k"], taps: Int[Tensor, "bp 9"], weights: Float[Tensor, "bp 9"]
) -> Float[Tensor, "b p k"]:
    """Weighted means of what pixels have gathered, by the answer of `around`."""
    b, _, k = values.shape
    return F.embedding_bag(taps, values.flatten(0, 1), mode="sum", per_sample_weights=weights).view(b, -1, k)
