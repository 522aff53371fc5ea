"""Light between parts of the surface; where rays from a pixel arrive is found once for all lights."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.synth.shadows import Rays, depth_in, grid_rays
from photonormal.synth.trace import NOWHERE

RAYS = 12  # from each pixel
FACING = 32  # exponent of the cosine between two pixels' normals that weighs what one has gathered for the other
GLOSS = 12  # exponent of the lobe that one half of them follows
SKIP = 6  # steps that a ray takes at once where nothing near it is as high
ENTERED = 0.05  # pixels of depth below the surface at which a ray has arrived


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
    solid: Float[Tensor, "b 3 s s"],
    normals: Float[Tensor, "b 3 s s"],
    pixel: Int[Tensor, "b r"],
    directions: Float[Tensor, "b r m 3"],
) -> Int[Tensor, "b r m"]:
    """Pixel that each ray meets first; -1 where it meets none, leads into the surface or is stopped out of sight.

    `solid` are heights (pixels), as shadows know them: of the visible surface, of where the view leaves the solid
    behind it, and of where it enters it again. What it meets below the visible surface sends nothing.
    """
    (b, _, s, _), m = solid.shape, directions.shape[2]
    M, (top, leaves, _) = normals.flatten(2).transpose(1, 2).flatten(0, 1), (h.flatten() for h in solid.unbind(1))
    start = (pixel + torch.arange(b, device=top.device)[:, None] * (s * s)).flatten()
    outwards = (directions.flatten(0, 1) @ M[start, :, None])[..., 0] > 0  # (b r, m)
    number = outwards.flatten().nonzero()[:, 0]  # of each ray that is followed
    d, start = directions.flatten(0, 2)[number], start[number // m].to(torch.int32)
    step = d * d.new_tensor([1, -1, 1])
    step = step / step[:, :2].abs().amax(1, True).clamp(min=1e-4)
    rays = grid_rays(start, top[start], step, s)
    higher = solid[:, 0].amax((1, 2))[start // (s * s)] - rays.z
    last = torch.where(rays.rise > 0, rays.last.minimum(higher / rays.rise.clamp(min=1e-3)), rays.last)
    k = _arrivals(solid, rays._replace(last=last))
    arrived = k.nonzero()[:, 0]
    d, k, rays, last = d[arrived], k[arrived], rays.some(arrived), last[arrived].floor()
    seen = torch.full_like(rays.at, -1)
    for n in (1, -1, 0):  # the pixel at the arrival, or, where it looks away, the one before it or after it
        step = (k + n).minimum(last)
        at = rays.at + (step * rays.major + (step * rays.slope).round() * rays.minor).to(torch.int32)
        seen = torch.where((M[at] * d).sum(1) < 0, at, seen)
    level = rays.z + k * rays.rise
    above = top[at] - level < level - leaves[at]
    seen = torch.where(above & (seen >= 0), seen % (s * s), -1)
    found = torch.full((len(outwards) * m,), -1, dtype=torch.int32, device=top.device)
    found[number[arrived]] = seen
    return found.view(b, -1, m)


def _arrivals(solid: Float[Tensor, "b 3 s s"], rays: Rays) -> Float[Tensor, " k"]:
    """Steps of one pixel after which each ray is in the solid; 0 where it never is.

    SKIP steps are taken at once where nothing near them is as high.
    """
    s = solid.shape[-1]
    looked = torch.cat([solid, highest_near(solid[:, 0], 2 * SKIP + 3)[:, None]], 1)
    looked = looked.movedim(1, -1).flatten(0, 2)  # what a step looks up, side by side in memory
    edge = (SKIP + 1) * (s + 1)  # a ray may leave by its last step
    looked = F.pad(looked, (0, 0, edge, edge), value=NOWHERE)
    rays = rays._replace(at=rays.at + edge, major=rays.major.float())
    arrived, k = torch.zeros_like(rays.z), torch.ones_like(rays.z)
    number = torch.arange(len(k), device=k.device)
    while len(number):
        across, fall = rays.minor.float(), SKIP * rays.rise.clamp(max=0)
        depth, going = rays.z, k <= rays.last
        for _ in range(4):  # then rays that have arrived are dropped
            t, level = k * rays.slope, torch.addcmul(rays.z, k, rays.rise)
            i = t.floor()
            index = (k * rays.major).addcmul_(i, across).to(torch.int32).add_(rays.at)
            *here, near = looked.index_select(0, index).unbind(1)
            *there, _ = looked.index_select(0, index.add_(rays.minor)).unbind(1)
            depth = depth_in(*here, level).lerp_(depth_in(*there, level), t.sub_(i))
            going = (depth <= ENTERED) & (k <= rays.last)
            k = k + going * torch.where(level + fall > near, SKIP, 1)
        met = ((depth > ENTERED) & (k <= rays.last)).nonzero()[:, 0]
        arrived[number[met]] = k[met]
        open = (going & (k <= rays.last)).nonzero()[:, 0]
        number, k, rays = number[open], k[open], rays.some(open)
    return arrived


def highest_near(height: Float[Tensor, "b s s"], width: int) -> Float[Tensor, "b s s"]:
    """Largest height in the square of `width` pixels around each pixel."""
    h = F.max_pool2d(height[:, None], (1, width), 1, (0, width // 2))
    return F.max_pool2d(h, (width, 1), 1, (width // 2, 0))[:, 0]


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
