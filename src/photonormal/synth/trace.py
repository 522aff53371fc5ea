"""The visible surface of solids under an orthographic view: depth, exact unit normal and mask of each ray.

Light may pass behind what is seen: each ray is followed to where it leaves the solid, and to where it enters it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.bust import Bust
from photonormal.synth.meshes import MeshViews
from photonormal.synth.params import indices
from photonormal.synth.shapes import Field, Solids

Solid = Solids | Bust | MeshViews


@runtime_checkable
class Implicit(Protocol):
    """A surface where a function of points is zero; about the distance to it."""

    def field(self) -> Field: ...


REACH = 2.2  # no solid comes nearer to the camera, or is looked for farther behind the origin
WIDE, CELLS = 1.7, 24  # half width and resolution of the survey that finds where a solid is
NONE = 1e9  # distance of a ray that has not begun
NOWHERE = -1e4  # height, in pixels, of what isn't there
COARSE = 4  # pixels along a side of the blocks that share the first part of their way


@dataclass(frozen=True)
class WindowView:
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
    behind: Float[Tensor, "b 2 s s"]  # heights where rays leave the solid, and where they enter it again, or NOWHERE


def survey(solids: Solid, b: int, device: torch.device) -> tuple[WindowView, Float[Tensor, "b c"]]:
    """A coarse, wide view of whole solids: depths above which there is nothing, -inf where there is nothing at all."""
    view = WindowView(torch.zeros(b, 2, device=device), torch.full((b,), WIDE, device=device), CELLS)
    if isinstance(solids, MeshViews):
        return view, solids.surface(view.centre, view.half, CELLS)[0][:, 0].flatten(1)
    x, y = view.rays(CELLS)
    px = view.pixel[:, None]
    return view, _approach(
        solids.base_field(), x, y, 0.71 * px + solids.detail.bound()[:, None], 0.7 * px, torch.full_like(x, REACH)
    )


def approach(solids: Solid, view: WindowView, start: Float[Tensor, "b c"]) -> Float[Tensor, "b p"]:
    """Depth at which each pixel's ray may begin, from a survey's answer: blocks of pixels share their way there."""
    if isinstance(solids, MeshViews):
        return start.new_zeros(len(start), 1)
    s, px = view.size, view.pixel[:, None]
    x, y = view.rays(s // COARSE)
    width = px * COARSE * 0.71  # (b, 1) half diagonal of a block
    z = _surveyed(start, x, y, width)
    z = _approach(solids.base_field(), x, y, width + solids.detail.bound()[:, None], width, z)  # (b, blocks)
    z = z.view(-1, s // COARSE, s // COARSE)
    return z.repeat_interleave(COARSE, 1).repeat_interleave(COARSE, 2).flatten(1)


def visible_surface(solids: Implicit | MeshViews, view: WindowView, start: Float[Tensor, "b p"]) -> Geometry:
    """March each ray from where `approach` lets it begin to the surface, then false position on the bracketed root."""
    s, px = view.size, view.pixel[:, None]
    if isinstance(solids, MeshViews):
        maps, points = solids.surface(view.centre, view.half, s)
        mask = (maps[:, 0] > -torch.inf) & (maps[:, 3] > 0.01)
        height = torch.where(mask, maps[:, 0] / px[..., None], 0.0)
        behind = (maps[:, 4:] / px[..., None, None]).clamp(min=NOWHERE)
        return Geometry(height, maps[:, 1:4] * mask[:, None], mask, points, behind)
    field = solids.field()
    x, y = view.rays(s)
    z, hit = _cross(field, x, y, start, 0.4 * px)
    p = torch.stack([x, y, z], 1)  # (b, 3, p)
    n = surface_gradient(field, p)
    n = n / n.norm(dim=1, keepdim=True).clamp(min=1e-12)
    mask = hit & (n[:, 2] > 0.01)

    def image(values: Tensor) -> Tensor:
        return torch.where(mask[:, None], values, 0.0).view(-1, 3, s, s)

    height = torch.where(mask, z / px, 0.0).view(-1, s, s)
    behind = (_behind(field, x, y, torch.where(mask, z, torch.inf), px) / px[:, None]).clamp(min=NOWHERE)
    return Geometry(height, image(n), mask.view(-1, s, s), image(p), behind.view(-1, 2, s, s))


def _behind(f: Field, x: Tensor, y: Tensor, z: Tensor, px: Tensor) -> Float[Tensor, "b 2 p"]:
    """Where rays that go on from the visible surface `z` leave the solid, and where they enter it again, or -inf.

    They go no farther than to what is seen deepest: no light comes from below that.
    """
    deepest = z.amin(1, keepdim=True).clamp(min=-REACH, max=REACH)
    leaves = _onward(lambda p: -f(p), x, y, torch.where(z < torch.inf, z - px, -torch.inf), px, deepest)
    return torch.stack([leaves, _onward(f, x, y, leaves - px, px, deepest)], 1)


def _onward(f: Field, x: Tensor, y: Tensor, z: Tensor, shortest: Tensor, deepest: Tensor) -> Float[Tensor, "b p"]:
    """Where rays along -z that begin at `z` meet f < 0, to about a pixel; -inf where they don't above `deepest`."""
    met, step, before = torch.full_like(z, -torch.inf), torch.zeros_like(z), torch.zeros_like(z)
    active = z > deepest
    for round in range(4):  # rays that have arrived are dropped between rounds
        if not bool(active.any()):
            break
        i = indices(active)
        xi, yi, zi, at, last, d_last, going = (v.gather(1, i) for v in (x, y, z, met, step, before, active))
        for _ in range(3 + round):
            d = f(torch.stack([xi, yi, zi], 1))
            arrived = going & (d < 0)
            at = torch.where(arrived, zi + last * (d / (d - d_last).clamp(max=-1e-9)), at)
            going = going & ~arrived & (zi > deepest)
            last, d_last = (1.5 * d).maximum(shortest), d  # distances within a union are too short
            zi = zi - last
        z, met, step, before, active = (
            v.scatter(1, i, w) for v, w in ((z, zi), (met, at), (step, last), (before, d_last), (active, going))
        )
        shortest = shortest if round == 0 else 2 * shortest  # what is left grazes something
    return met


def surface_gradient(f: Field, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b 3 p"]:
    """Exact gradient of an implicit function."""
    with torch.enable_grad():
        p = p.detach().requires_grad_()
        return torch.autograd.grad(f(p).sum(), p)[0]


def _surveyed(start: Float[Tensor, "b c"], x: Tensor, y: Tensor, width: Tensor) -> Tensor:
    """Where the survey lets blocks of half diagonal `width` begin: at the highest of the cells that they touch."""
    z = torch.full_like(x, -torch.inf)
    for i in (-1, 1):
        for j in (-1, 1):
            column = ((x + i * width) / WIDE + 1) * (CELLS / 2)
            row = (1 - (y + j * width) / WIDE) * (CELLS / 2)
            cell = row.clamp(0, CELLS - 1).long() * CELLS + column.clamp(0, CELLS - 1).long()
            z = torch.maximum(z, start.gather(1, cell))
    return z


def _approach(base: Field, x: Tensor, y: Tensor, spread: Tensor, shortest: Tensor, z: Tensor) -> Float[Tensor, "b p"]:
    """Depth down to which no ray within `spread` of (x, y) has met a surface; -inf where there is none at all."""
    found = torch.zeros_like(x, dtype=torch.bool)
    active = z > -REACH
    for round in range(6):  # rays that have arrived are dropped between rounds
        if not bool(active.any()):
            break
        i = indices(active)
        shortest = shortest if round < 3 else 2 * shortest  # what is left grazes something
        xi, yi, zi, near = x.gather(1, i), y.gather(1, i), z.gather(1, i), found.gather(1, i)
        for _ in range(4):
            d = base(torch.stack([xi, yi, zi.clamp(min=-REACH)], 1)) - spread
            arrived = (d <= 0) & (zi > -REACH) & ~near
            step = torch.lerp(d.maximum(shortest), -shortest.expand_as(d), arrived.to(d.dtype))
            zi = torch.addcmul(zi, step, (~near).to(d.dtype), value=-1)
            near = near | arrived
        z, found = z.scatter(1, i, zi), found.scatter(1, i, near)
        active = (z > -REACH) & ~found
    return torch.where(found, z, -torch.inf)


def _cross(f: Field, x: Tensor, y: Tensor, z: Tensor, shortest: Tensor) -> tuple[Tensor, Tensor]:
    """First crossing from outside to inside along -z from `z`: its depth, and whether there is one.

    A step is the distance over the rate at which it shrank along the last one, a little longer than the distance at
    most; a step too far ends inside the solid, and the root lies between its ends.
    """
    high, low = z.clone(), torch.zeros_like(z)  # the last point outside, the first inside
    d_high, d_low = torch.full_like(z, NONE), torch.zeros_like(z)  # the distances there
    active = z > -torch.inf
    hit = torch.zeros_like(active)
    for round in range(4):  # rays that have arrived are dropped between rounds
        if not bool(active.any()):
            break
        i = indices(active)
        shortest = shortest if round < 2 else 2 * shortest  # what is left grazes something
        xi, yi, zi, hi, lo, di_high, di_low, going, found = (
            v.gather(1, i) for v in (x, y, z, high, low, d_high, d_low, active, hit)
        )
        for _ in range(3 + 2 * round):
            d = f(torch.stack([xi, yi, zi], 1))
            begun = di_high < NONE
            inside = going & (d < 0) & begun
            found |= inside
            now = inside.to(d.dtype)  # 0 or 1: `lerp` chooses several times faster than `where` does
            lo, di_low = torch.lerp(lo, zi, now), torch.lerp(di_low, d, now)
            going = going & ~inside & (zi > -REACH)
            rate = (di_high - d) / (hi - zi).clamp(min=1e-6)  # huge before the second step
            step = torch.minimum(d / rate.clamp(min=0.25, max=2.0), d + 2 * shortest).maximum(shortest)
            # a ray that begins inside, under a rare peak, goes back first
            step = torch.lerp(step, 2 * d - 4 * shortest, ((d < 0) & ~begun).to(d.dtype))
            on = going.to(d.dtype)
            hi, di_high = torch.lerp(hi, zi, on), torch.lerp(di_high, d, on * (d >= 0))
            zi = torch.addcmul(zi, step, on, value=-1)
        z, high, low = z.scatter(1, i, zi), high.scatter(1, i, hi), low.scatter(1, i, lo)
        d_high, d_low = d_high.scatter(1, i, di_high), d_low.scatter(1, i, di_low)
        active, hit = torch.zeros_like(active).scatter(1, i, going), hit.scatter(1, i, found)
    i = indices(hit)
    root = _false_position(f, *(v.gather(1, i) for v in (x, y, high, low, d_high, d_low)))
    return torch.zeros_like(x).scatter(1, i, root) * hit, hit


def _false_position(f: Field, x: Tensor, y: Tensor, hi: Tensor, lo: Tensor, d_hi: Tensor, d_lo: Tensor) -> Tensor:
    """Illinois variant of regula falsi between `hi` (outside) and `lo` (inside); the bracket is never lost."""
    z = lo
    for _ in range(3):
        t = (d_hi / (d_hi - d_lo).clamp(min=1e-9)).clamp(0.02, 0.98)
        z = hi + t * (lo - hi)
        d = f(torch.stack([x, y, z], 1))
        inside = (d < 0).to(d.dtype)
        hi, lo = torch.lerp(z, hi, inside), torch.lerp(lo, z, inside)
        d_hi, d_lo = torch.lerp(d, d_hi * 0.5, inside), torch.lerp(d_lo * 0.5, d, inside)
    return z
