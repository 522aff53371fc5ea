"""The visible surface of solids under an orthographic view: depth, exact unit normal and mask of each ray."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.bust import Bust
from photonormal.synth.shapes import Solids

Field = Callable[[Tensor], Tensor]  # (b, p, 3) -> (b, p)

REACH = 2.2  # no solid comes nearer to the camera, or is looked for farther behind the origin
COARSE = 4  # pixels along a side of the blocks that share the first part of their way


@dataclass(frozen=True)
class View:
    """Square orthographic windows of `size` pixels: centre and half width in units of length."""

    centre: Float[Tensor, "b 2"]
    half: Float[Tensor, " b"]
    size: int

    @property
    def pixel(self) -> Float[Tensor, " b"]:
        """Side of a pixel in units of length."""
        return 2 * self.half / self.size

    def rays(self, size: int) -> tuple[Float[Tensor, "b p"], Float[Tensor, "b p"]]:
        """x and y of the centres of size x size cells, row 0 on top."""
        t = (torch.arange(size, device=self.half.device) + 0.5) * (2 / size) - 1
        x = self.centre[:, 0, None] + self.half[:, None] * t.repeat(size)
        y = self.centre[:, 1, None] - self.half[:, None] * t.repeat_interleave(size)
        return x, y


@dataclass(frozen=True)
class Geometry:
    """What the camera sees of `b` scenes, in pixels: heights towards the camera, unit normals, and where they are."""

    height: Float[Tensor, "b s s"]
    normals: Float[Tensor, "b 3 s s"]
    mask: Bool[Tensor, "b s s"]
    points: Float[Tensor, "b 3 s s"]  # in the solid's own units, for textures


def visible_surface(solids: Solids | Bust, view: View) -> Geometry:
    """March to the surface: blocks of pixels first, then each pixel, then false position on the bracketed root."""
    solids = solids.trimmed()
    s, px = view.size, view.pixel[:, None]
    x, y = view.rays(s // COARSE)
    width = px * COARSE * 0.75  # (b, 1) half diagonal of a block
    spread = width + solids.detail.bound()[:, None]
    z = _approach(solids.base, x, y, spread, 0.5 * px * COARSE)  # (b, blocks)
    z = _nearest(z.view(-1, s // COARSE, s // COARSE)).flatten(1)
    x, y = view.rays(s)
    z, hit = _cross(solids, x, y, z, 0.3 * px)
    p = torch.stack([x, y, z], -1)  # (b, p, 3)
    n = gradient(solids, p)
    n = n / n.norm(dim=-1, keepdim=True).clamp(min=1e-12)
    mask = hit & (n[..., 2] > 0.01)

    def image(values: Tensor) -> Tensor:
        return torch.where(mask[..., None], values, 0.0).transpose(1, 2).reshape(-1, 3, s, s)

    height = torch.where(mask, z / px, torch.zeros_like(z)).view(-1, s, s)
    return Geometry(height, image(n), mask.view(-1, s, s), image(p))


def first_seen(solids: Solids | Bust, view: View) -> Bool[Tensor, "b s s"]:
    """Where a coarse view meets the solids, to within a pixel."""
    solids = solids.trimmed()
    x, y = view.rays(view.size)
    px = view.pixel[:, None]
    z = _approach(solids.base, x, y, 0.5 * px + solids.detail.bound()[:, None], 0.5 * px)
    return (z > -torch.inf).view(-1, view.size, view.size)


def gradient(f: Field, p: Float[Tensor, "b p 3"]) -> Float[Tensor, "b p 3"]:
    """Exact gradient of an implicit function."""
    with torch.enable_grad():
        p = p.detach().requires_grad_()
        return torch.autograd.grad(f(p).sum(), p)[0]


def _approach(base: Field, x: Tensor, y: Tensor, spread: Tensor, shortest: Tensor, steps: int = 40) -> Tensor:
    """Depth down to which no ray of a block has met a surface; -inf where there is none at all."""
    z = torch.full_like(x, REACH)
    found = torch.zeros_like(x, dtype=torch.bool)
    for _ in range(steps):
        d = base(torch.stack([x, y, z], -1)) - spread
        found |= d <= 0
        if bool((found | (z < -REACH)).all()):
            break
        z = torch.where(found, z, z - torch.maximum(d, shortest))
    return torch.where(z < -REACH, -torch.inf, z + shortest)


def _nearest(z: Float[Tensor, "b c c"], factor: int = COARSE) -> Float[Tensor, "b s s"]:
    return z.repeat_interleave(factor, 1).repeat_interleave(factor, 2)


def _cross(f: Field, x: Tensor, y: Tensor, z: Tensor, shortest: Tensor) -> tuple[Tensor, Tensor]:
    """First crossing from outside to inside along -z from `z`: its depth, and whether there is one."""
    high, low = z.clone(), torch.full_like(z, torch.nan)  # the last point outside, the first inside
    d_high, d_low = torch.full_like(z, 1e9), torch.zeros_like(z)
    active = z > -torch.inf
    for round in range(6):  # rays that have arrived are dropped between rounds
        if not bool(active.any()):
            break
        i = _indices(active)
        xi, yi, zi, hi, lo, di_high, di_low, going = (
            v.gather(1, i) for v in (x, y, z, high, low, d_high, d_low, active)
        )
        for _ in range(4 + 2 * round):
            d = f(torch.stack([xi, yi, zi], -1))
            inside = going & (d < 0)
            lo, di_low = torch.where(inside, zi, lo), torch.where(inside, d, di_low)
            going = going & ~inside & (zi > -REACH)
            hi, di_high = torch.where(going, zi, hi), torch.where(going, d, di_high)
            zi = torch.where(going, zi - torch.maximum(0.9 * d, shortest), zi)
        z, high, low = z.scatter(1, i, zi), high.scatter(1, i, hi), low.scatter(1, i, lo)
        d_high, d_low = d_high.scatter(1, i, di_high), d_low.scatter(1, i, di_low)
        active = torch.zeros_like(active).scatter(1, i, going)
    hit = low > -REACH  # False for NaN
    i = _indices(hit)
    root = _false_position(f, *(v.gather(1, i) for v in (x, y, high, low, d_high, d_low)))
    return torch.zeros_like(x).scatter(1, i, root).where(hit, 0.0), hit


def _indices(chosen: Bool[Tensor, "b p"]) -> Tensor:
    """Indices of the chosen ones in each row, filled up with others where a row has fewer: (b, most of any row)."""
    if chosen.shape[0] == 1:
        i = chosen.nonzero()[:, 1][None]
        return i if i.numel() else i.new_zeros(1, 1)
    count = max(1, int(chosen.sum(1).max()))
    return chosen.to(torch.int8).argsort(dim=1, descending=True, stable=True)[:, :count]


def _false_position(f: Field, x: Tensor, y: Tensor, hi: Tensor, lo: Tensor, d_hi: Tensor, d_lo: Tensor) -> Tensor:
    """Illinois variant of regula falsi between `hi` (outside) and `lo` (inside); bracket never lost."""
    hi, lo = torch.nan_to_num(hi), torch.nan_to_num(lo)
    z = lo
    for _ in range(3):
        t = (d_hi / (d_hi - d_lo).clamp(min=1e-9)).clamp(0.02, 0.98)
        z = hi + t * (lo - hi)
        d = f(torch.stack([x, y, z], -1))
        inside = d < 0
        hi, lo = torch.where(inside, hi, z), torch.where(inside, z, lo)
        d_hi, d_lo = torch.where(inside, d_hi * 0.5, d), torch.where(inside, d, d_lo * 0.5)
    return z
