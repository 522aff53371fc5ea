"""Solids as implicit functions: negative inside, positive outside, about the distance to the surface near it.

A solid is a union (sharp to blobby) of ellipsoids, superquadrics, a lathe shape and a backing wall, less ellipsoids and
half spaces, twisted, and displaced by noise, ridges, carved lines, pits, folds and grain.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.waves import Waves

FAR = 9.0  # distance at which an unused part is kept out of the way


@dataclass(frozen=True)
class Ellipsoids:
    """Unit superballs |M (p - c)|_e <= 1; e = 2 is an ellipsoid, 4 and 8 are ever more like a box."""

    M: Float[Tensor, "b k 3 3"]
    c: Float[Tensor, "b k 3"]
    e: Float[Tensor, "b k"]
    on: Bool[Tensor, "b k"]

    def distances(self, p: Float[Tensor, "b 3 p"], box: bool) -> Float[Tensor, "b k p"]:
        """(r - 1) times the shortest semi-axis, which never overestimates the distance outside."""
        b, k = self.on.shape
        M = self.M.transpose(1, 2).reshape(b, 3 * k, 3)  # the first rows of all parts, then the second, the third
        shift = (self.M @ self.c[..., None])[..., 0].transpose(1, 2).reshape(b, 3 * k, 1)
        s = torch.baddbmm(-shift, M, p).square().view(b, 3, k, -1)  # (b, 3, k, p)
        e = self.e[..., None]
        if box:
            s = torch.where(e[:, None] > 2, s.square(), s)
            s = torch.where(e[:, None] > 4, s.square(), s)
        r = (s[:, 0] + s[:, 1] + s[:, 2] + 1e-12).sqrt()  # (b, k, p)
        if box:
            r = torch.where(e > 2, r.sqrt(), r)
            r = torch.where(e > 4, r.sqrt(), r)
        shortest = 1 / self.M.norm(dim=-1).amax(-1)[..., None]  # (b, k, 1)
        d = (r - 1) * shortest
        return d if bool(self.on.all()) else torch.where(self.on[..., None], d, FAR)


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

    def distance(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        x, y, z = (self.R @ p).unbind(1)  # (b, p)
        profile = self.radius[:, None] + (
            self.a[..., None] * torch.sin(self.f[..., None] * y[:, None] + self.phase[..., None])
        ).sum(1)
        flutes = 1 + self.flute_depth[:, None] * torch.cos(self.flutes[:, None] * torch.atan2(z, x + 1e-9))
        profile = profile.clamp(min=0.12) * flutes
        steep = 1 / (1 + (self.a * self.f).square().sum(-1, keepdim=True) / 2).sqrt()
        r = (x * x + z * z + 1e-12).sqrt()
        H = self.height[:, None]
        d = smooth_max((r - profile) * steep, y.abs() - H, 0.015)
        wall = self.wall[:, None]
        inside = torch.maximum((r - profile + wall) * steep, wall - H - y)
        return torch.where(wall > 0, smooth_max(d, -inside, 0.01), d)


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

    def __call__(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        def per(x: Tensor) -> Tensor:
            return x[:, None]

        relief = p.new_zeros(len(p), p.shape[2])
        if self.noise[:, 1].any() or self.ridge.any() or self.pit.any():
            g2 = self.middle(p)[:, 0]  # (b, p)
            relief = per(self.noise[:, 1]) * g2
            if self.ridge.any():
                relief = relief + per(self.ridge) * (0.8 - (g2 * g2 + 1e-4).sqrt())
            if self.pit.any():
                relief = relief - per(self.pit) * torch.sigmoid((g2 - 1.1) * 8)
        if self.noise[:, 2].any():
            relief = relief + per(self.noise[:, 2]) * self.fine(p)[:, 0]
        if not (self.noise[:, 0].any() or self.fold.any() or self.patch.any() or self.carve.any()):
            return relief
        g1 = self.coarse(p)[:, 0]
        if self.fold.any():
            phase = (self.fold_w @ p)[:, 0] + 1.5 * g1
            cusp = 1 - 2 * (torch.sin(phase / 2).square() + 1e-4).sqrt()
            relief = relief + per(self.fold) * (per(self.fold_cusp) * cusp + per(1 - self.fold_cusp) * torch.sin(phase))
        if self.patch.any():
            relief = relief * (1 - per(self.patch) * torch.sigmoid(-6 * g1))
        if self.carve.any():
            relief = relief - per(self.carve) * torch.exp(-(g1 / per(self.carve_width)).square())
        return relief + per(self.noise[:, 0]) * g1

    def bound(self) -> Float[Tensor, " b"]:
        """About the largest displacement outwards."""
        ridge = 0.8 * self.ridge.clamp(min=0) - 1.8 * self.ridge.clamp(max=0)
        return 3.2 * self.noise.norm(dim=-1) + ridge + self.fold

    def any(self) -> bool:
        """Whether there is anything to add."""
        return bool((self.bound() + self.pit + self.carve).any())


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

    def base(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        """Distance without the displacement."""
        if self.twist.any():
            x, y, z = p.unbind(1)
            angle = self.twist[:, None] * y
            c, s = angle.cos(), angle.sin()
            p = torch.stack([c * x + s * z, y, c * z - s * x], 1)
        d = self.parts.distances(p, bool((self.parts.e > 2).any()))  # (b, k, p)
        if self.lathe.on.any():
            lathe = self.lathe.distance(p)
            lathe = lathe if bool(self.lathe.on.all()) else torch.where(self.lathe.on[:, None], lathe, FAR)
            d = torch.cat([d, lathe[:, None]], 1)
        if (self.wall_o > -FAR).any():
            d = torch.cat([d, torch.baddbmm(-self.wall_o[:, None, None], self.wall_n[:, None], p)], 1)
        k = self.blend[:, None]
        if d.shape[1] > 1:
            nearest = d.amin(1)
            d = nearest - k * torch.exp((nearest[:, None] - d) / k[:, None]).sum(1).log()  # smooth minimum
        else:
            d = d[:, 0]
        if self.holes.on.any():
            hole = self.holes.distances(p, False).amin(1)
            d = smooth_max(d, -hole, k)
        if (self.cut_o < FAR).any():
            cut = torch.baddbmm(-self.cut_o[..., None], self.cut_n, p).amax(1)
            d = smooth_max(d, cut, 0.008)
        return d

    def __call__(self, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b p"]:
        """About the signed distance to the displaced surface."""
        d = self.base(p)
        return d - self.detail(p) if self.detail.any() else d


def smooth_max(a: Tensor, b: Tensor, k: Tensor | float) -> Tensor:
    """Maximum of two distances whose edge is rounded over a width of about `k`."""
    return (a + b + ((a - b).square() + k * k).sqrt()) / 2
