"""One bounce of light between parts of the surface; where rays from a receiver arrive is found once for all lights."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.synth.params import indices

NOTHING = -1e4  # height where there is no surface
RAYS = 48
STEPS = 20


def hits(
    height: Float[Tensor, "b s s"],
    mask: Bool[Tensor, "b s s"],
    normals: Float[Tensor, "b 3 s s"],
    receivers: Int[Tensor, " r"],
    seed: int,
) -> Int[Tensor, "b r m"]:
    """Pixel that each of RAYS cosine-distributed rays from each receiver pixel meets first; -1 where it meets none.

    The height field is marched in steps that grow with distance. A ray that passes well below a visible point passes
    behind it and goes on; one that arrives at a visible point from behind is stopped, and sees nothing that is lit.
    """
    b, s, _ = height.shape
    device = height.device
    every = mask.flatten(1)[:, receivers]  # (b, r)
    chosen = indices(every)  # (b, q): those on the surface
    pixel = receivers[chosen]
    N = normals.flatten(2).gather(2, pixel[:, None].expand(-1, 3, -1)).transpose(1, 2)  # (b, q, 3)
    d = _directions(N, seed)  # (b, q, m, 3)
    dx, dy, dz = d[..., 0], -d[..., 1], d[..., 2]
    x, y, z = N[..., None].unbind(2)  # rays begin one pixel off the surface, at (col, row, z) in a frame one wider
    col, row = (pixel % s)[..., None] + 1.5 + x, (pixel // s)[..., None] + 1.5 - y
    z = height.flatten(1).gather(1, pixel)[..., None] + z
    wide = s + 2
    flat = F.pad(torch.where(mask, height, NOTHING), (1, 1, 1, 1), value=NOTHING).flatten()
    scene = torch.arange(b, device=device, dtype=torch.int32).view(b, 1, 1) * (wide * wide)
    end = torch.full(d.shape[:3], -1.0, device=device)  # length of each ray
    open = every.gather(1, chosen)[..., None].expand_as(end)
    before = torch.full_like(end, -1.0)
    reach = torch.cumsum((s / 12) ** torch.linspace(0, 1, STEPS), 0)
    reach = reach * (1.2 * s / reach[-1])

    def at(t: float | Tensor) -> Tensor:
        c = (col + t * dx).clamp_(0, wide - 1).to(torch.int32)
        return (row + t * dy).clamp_(0, wide - 1).to(torch.int32).mul_(wide).add_(c)

    for t, dt in zip(reach.tolist(), torch.diff(reach, prepend=torch.zeros(1)).tolist(), strict=True):
        depth = flat.index_select(0, (at(t) + scene).flatten()).view_as(end) - (z + t * dz)
        hit = open & (depth > 0) & (depth < 4.0 * dt + 4.0)
        arrived = t - dt * depth / (depth - before.clamp(max=-1e-3)).clamp(min=1e-3)
        end = torch.lerp(end, arrived, hit.to(end.dtype))
        open = open & ~hit
        before = depth
    last = at(end)
    last = (last // wide - 1).clamp(0, s - 1) * s + (last % wide - 1).clamp(0, s - 1)
    met = normals.flatten(2).transpose(1, 2).flatten(0, 1)  # (b s s, 3)
    scene = torch.arange(b, device=device).view(b, 1, 1) * (s * s)
    front = (met.index_select(0, (last + scene).flatten()).view_as(d) * d).sum(-1) < 0
    last = torch.where((end >= 0) & front, last, -1)
    none = torch.full((b, len(receivers), RAYS), -1, dtype=torch.int32, device=device)
    return none.scatter(1, chosen[..., None].expand_as(last), last)


def _directions(N: Float[Tensor, "b r 3"], seed: int) -> Float[Tensor, "b r m 3"]:
    """Rays around each normal with density cos / pi: a stratified set, turned at random for each receiver."""
    b, r, _ = N.shape
    k = torch.arange(RAYS, device=N.device) + 0.5
    radius, phi = (k / RAYS).sqrt(), k * (math.pi * (1 + 5**0.5))
    turn = torch.rand((b, r, 1), generator=torch.Generator().manual_seed(seed)).to(N.device) * (2 * math.pi)
    u, v, w = radius * torch.cos(phi + turn), radius * torch.sin(phi + turn), (1 - radius**2).sqrt().expand(b, r, -1)
    x, y, z = (c[..., None] for c in N.unbind(-1))
    z = z.clamp(min=-0.99)
    a = -1 / (1 + z)  # Duff et al., JCGT 2017: a tangent frame without a square root
    c = x * y * a
    t1 = torch.cat([1 + x * x * a, c, -x], -1)[:, :, None]
    t2 = torch.cat([c, 1 + y * y * a, -y], -1)[:, :, None]
    return u[..., None] * t1 + v[..., None] * t2 + w[..., None] * N[:, :, None]


def gather(
    found: Int[Tensor, "b r m"], radiance: Float[Tensor, "b q k"], stride: int, size: int
) -> Float[Tensor, "b r k"]:
    """Mean radiance over a receiver's rays; `radiance` is known on every `stride`-th pixel of each row and column."""
    b, q, k = radiance.shape
    side = size // stride
    patch = (found // size // stride) * side + (found % size) // stride  # (b, r, m)
    offset = torch.arange(b, device=found.device).view(b, 1, 1) * q
    index = torch.where(found >= 0, patch + offset, b * q).flatten(0, 1)
    table = torch.cat([radiance.reshape(b * q, k), radiance.new_zeros(1, k)])
    return F.embedding_bag(index, table, mode="sum", padding_idx=b * q).view(b, -1, k) / RAYS


def spread(
    values: Float[Tensor, "b r k"],
    on: Bool[Tensor, "b r"],
    normals: Float[Tensor, "b r 3"],
    pixel: Int[Tensor, "b p"],
    own: Float[Tensor, "b p 3"],
    size: int,
) -> Float[Tensor, "b p k"]:
    """Values of the receivers' grid at pixels: bilinear, weighted towards receivers that face the same way."""
    b, r, k = values.shape
    side = math.isqrt(r)
    c = ((pixel % size).float() + 0.5) * (side / size) - 0.5
    w = ((pixel // size).float() + 0.5) * (side / size) - 0.5
    c0, w0 = c.floor(), w.floor()
    scene = torch.arange(b, device=pixel.device).view(b, 1) * r
    taps, weights = [], []
    for i in (0, 1):
        for j in (0, 1):
            at = (w0 + i).clamp(0, side - 1) * side + (c0 + j).clamp(0, side - 1)
            at = at.long() + scene  # (b, p)
            area = (1 - (w - w0 - i).abs()) * (1 - (c - c0 - j).abs())
            same = (normals.reshape(-1, 3)[at] * own).sum(-1).clamp(min=0.05)
            weights.append((area + 0.02) * same**2 * on.reshape(-1)[at])
            taps.append(at)
    weight = torch.stack(weights, -1)
    weight = weight / weight.sum(-1, keepdim=True).clamp(min=1e-6)
    index = torch.stack(taps, -1).flatten(0, 1)
    out = F.embedding_bag(index, values.reshape(b * r, k), mode="sum", per_sample_weights=weight.flatten(0, 1))
    return out.view(b, -1, k)
