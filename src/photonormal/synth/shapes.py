"""Solids as implicit functions: negative inside, positive outside, about the distance to the surface near it.

A solid is a union (sharp to blobby) of ellipsoids, superquadrics, a lathe shape and a backing wall, less ellipsoids and
half spaces, twisted, and displaced by noise, ridges, carved lines, pits, folds and grain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.waves import Waves

Field = Callable[[Tensor], Tensor]  # points (b, 3, p) -> a number for each

FAR = 9.0  # distance at which an unused part is kept out of the way


@dataclass(frozen=True)
class Ellipsoids:
    """Unit superballs |M (p - c)|_e <= 1; e = 2 is an ellipsoid, 4 and 8 are ever more like a box."""

    M: Float[Tensor, "b k 3 3"]
    c: Float[Tensor, "b k 3"]
    e: Float[Tensor, "b k"]
    on: Bool[Tensor, "b k"]

    def field(self) -> Field:
        """Distances (b, k, p): (r - 1) times the shortest semi-axis, which never overestimates outside."""
        b, k = self.on.shape
        M = self.M.transpose(1, 2).reshape(b, 3 * k, 3)  # the first rows of all parts, then the second, the third
        shift = -(self.M @ self.c[..., None])[..., 0].transpose(1, 2).reshape(b, 3 * k, 1)
        shortest = 1 / self.M.norm(dim=-1).amax(-1)[..., None]  # (b, k, 1)
        centre = FAR * (~self.on)[..., None] - shortest
        square, fourth = self.e[..., None] > 2, self.e[..., None] > 4
        boxes = bool((square & self.on[..., None]).any())

        def distances(p: Tensor) -> Tensor:
            s = torch.baddbmm(shift, M, p).square().view(b, 3, k, -1)  # (b, 3, k, p)
            if boxes:
                s = torch.where(square[:, None], s.square(), s)
                s = torch.where(fourth[:, None], s.square(), s)
            r = (s[:, 0] + s[:, 1] + s[:, 2] + 1e-12).sqrt()  # (b, k, p)
            if boxes:
                r = torch.where(square, r.sqrt(), r)
                r = torch.where(fourth, r.sqrt(), r)
            return torch.addcmul(centre, r, shortest)

        return distances


@dataclass(frozen=True)
class Lathe:
    """A profile turned about an axis, fluted and hollowed where asked: vases, bowls, columns, rings of a goblet."""

    R: Float[Tensor, "b 3 3"]  # world -> own frame, axis y
    height: Float[Tensor, " b"]
    radius: Float[Tensor, " b"]
    a: Float[Tensor, "b m"]
    f: Float[Tensor, "b m"]
    phase: Float[Tensor, "b m"]
    flutes: Float[Tensor, " b"]
    flute_depth: Float[Tensor, " b"]
    wall: Float[Tensor, " b"]  # thickness of a hollow one; solid where 0
    on: Bool[Tensor, " b"]

    def field(self) -> Field:
        """Distance (b, p); far where there is no lathe shape."""
        steep = 1 / (1 + (self.a * self.f).square().sum(-1, keepdim=True) / 2).sqrt()  # (b, 1)
        off, H, wall = FAR * (~self.on)[:, None], self.height[:, None], self.wall[:, None]
        fluted = bool((self.flute_depth * self.on).any())
        hollow = wall > 0

        def distance(p: Tensor) -> Tensor:
            x, y, z = (self.R @ p).unbind(1)  # (b, p)
            waves = torch.sin(torch.addcmul(self.phase[..., None], self.f[..., None], y[:, None]))
            profile = (self.radius[:, None] + (self.a[:, None] @ waves)[:, 0]).clamp(min=0.12)
            if fluted:
                angle = torch.atan2(z, x + 1e-9)
                profile = profile * (1 + self.flute_depth[:, None] * torch.cos(self.flutes[:, None] * angle))
            r = (x * x + z * z + 1e-12).sqrt()
            d = smooth_max((r - profile) * steep, y.abs() - H, 0.015)
            if bool(hollow.any()):
                inside = torch.maximum((r - profile + wall) * steep, wall - H - y)
                d = torch.where(hollow, smooth_max(d, -inside, 0.01), d)
            return d + off

        return distance


@dataclass(frozen=True)
class Detail:
    """Displacement of the surface, in units of length, out of a coarse, a middle and a fine random field."""

    coarse: Waves
    middle: Waves
    fine: Waves
    noise: Float[Tensor, "b 3"]  # amplitude of each field
    ridge: Float[Tensor, " b"]  # creases where the middle field is zero
    carve: Float[Tensor, " b"]  # grooves along the zero lines of the coarse field
    carve_width: Float[Tensor, " b"]
    pit: Float[Tensor, " b"]
    fold: Float[Tensor, " b"]  # cloth: parallel waves warped by the coarse field
    fold_w: Float[Tensor, "b 1 3"]
    fold_cusp: Float[Tensor, " b"]  # 0: sine; 1: cusped
    patch: Float[Tensor, " b"]  # 0: everywhere; 1: only where the coarse field is positive

    def field(self) -> Field | None:
        """Displacement outwards (b, p), or None where there is none at all."""
        noise, ridge, carve, pit, fold, patch = (
            bool(x.any()) for x in (self.noise, self.ridge, self.carve, self.pit, self.fold, self.patch)
        )
        if not (noise or ridge or carve or pit or fold):
            return None
        low, mid, high = (x[:, None] for x in self.noise.unbind(-1))  # (b, 1)
        needs_middle, needs_fine = bool(mid.any()) or ridge or pit, bool(high.any())
        needs_coarse = bool(low.any()) or fold or patch or carve
        cusped, wide = self.fold_cusp[:, None], self.carve_width[:, None]

        def relief(p: Tensor) -> Tensor:
            out = torch.zeros_like(p[:, 0])
            if needs_middle:
                g = self.middle(p)[:, 0]  # (b, p)
                out = mid * g
                if ridge:
                    out = out + self.ridge[:, None] * (0.8 - (g * g + 1e-4).sqrt())
                if pit:
                    out = out - self.pit[:, None] * torch.sigmoid((g - 1.1) * 8)
            if needs_fine:
                out = torch.addcmul(out, self.fine(p)[:, 0], high)
            if not needs_coarse:
                return out
            g = self.coarse(p)[:, 0]
            if fold:
                phase = (self.fold_w @ p)[:, 0] + 1.5 * g
                cusp = 1 - 2 * (torch.sin(phase / 2).square() + 1e-4).sqrt()
                out = out + self.fold[:, None] * torch.lerp(torch.sin(phase), cusp, cusped)
            if patch:
                out = out * (1 - self.patch[:, None] * torch.sigmoid(-6 * g))
            if carve:
                out = out - self.carve[:, None] * torch.exp(-(g / wide).square())
            return torch.addcmul(out, g, low)

        return relief

    def bound(self) -> Float[Tensor, " b"]:
        """About the largest displacement outwards."""
        ridge = 0.8 * self.ridge.clamp(min=0) - 1.8 * self.ridge.clamp(max=0)
        return 3.2 * self.noise.norm(dim=-1) + ridge + self.fold


@dataclass(frozen=True)
class Solids:
    """`b` solids, about one unit in radius and centred on the origin."""

    parts: Ellipsoids
    holes: Ellipsoids
    lathe: Lathe
    blend: Float[Tensor, " b"]  # width of the smooth union
    cut_n: Float[Tensor, "b j 3"]  # half spaces n.p > o are cut away
    cut_o: Float[Tensor, "b j"]
    wall_n: Float[Tensor, "b 3"]  # backing wall n.p <= o
    wall_o: Float[Tensor, " b"]
    twist: Float[Tensor, " b"]  # radians per unit of height
    detail: Detail

    def trimmed(self) -> Solids:
        """The same solids without the parts that none of them uses."""

        def used(parts: Ellipsoids) -> Ellipsoids:
            k = max(1, int(parts.on.sum(1).max()))
            return Ellipsoids(*(getattr(parts, f.name)[:, :k] for f in fields(parts)))

        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return Solids(**{**values, "parts": used(self.parts), "holes": used(self.holes)})

    def base_field(self) -> Field:
        """Distance without the displacement."""
        s = self.trimmed()
        parts, k = s.parts.field(), s.blend[:, None]
        lathe = s.lathe.field() if bool(s.lathe.on.any()) else None
        wall = bool((s.wall_o > -FAR).any())
        holes = s.holes.field() if bool(s.holes.on.any()) else None
        cut, twist = bool((s.cut_o < FAR).any()), bool(s.twist.any())
        wall_o, wall_n, cut_o = -s.wall_o[:, None, None], s.wall_n[:, None], -s.cut_o[..., None]

        def base(p: Tensor) -> Tensor:
            if twist:
                x, y, z = p.unbind(1)
                angle = s.twist[:, None] * y
                c, v = angle.cos(), angle.sin()
                p = torch.stack([c * x + v * z, y, c * z - v * x], 1)
            d = parts(p)  # (b, k, p)
            if lathe is not None:
                d = torch.cat([d, lathe(p)[:, None]], 1)
            if wall:
                d = torch.cat([d, torch.baddbmm(wall_o, wall_n, p)], 1)
            if d.shape[1] > 1:
                nearest = d.amin(1)
                d = nearest - k * torch.exp((nearest[:, None] - d) / k[:, None]).sum(1).log()  # smooth minimum
            else:
                d = d[:, 0]
            if holes is not None:
                d = smooth_max(d, -holes(p).amin(1), k)
            if cut:
                d = smooth_max(d, torch.baddbmm(cut_o, s.cut_n, p).amax(1), 0.008)
            return d

        return base

    def field(self) -> Field:
        """About the signed distance to the displaced surface, ready to be asked many times."""
        base, detail = self.base_field(), self.detail.field()
        return base if detail is None else lambda p: base(p) - detail(p)

    def __call__(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        """The field at points."""
        return self.field()(p)


def smooth_max(a: Tensor, b: Tensor, k: Tensor | float) -> Tensor:
    """Maximum of two distances whose edge is rounded over a width of about `k`."""
    return (a + b + ((a - b).square() + k * k).sqrt()) / 2
