"""Rendered solids whose depth jumps: thin occluders, a stem, deep bowls, a smooth animal, a heap; exact normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import label

import photonormal as pn
from photonormal.synth.trace import REACH, WindowView, visible_surface


def ball(p: torch.Tensor, centre: tuple, axes: tuple | float) -> torch.Tensor:
    """About the distance to an ellipsoid; `p` (1, 3, n)."""
    axes = torch.as_tensor(axes, dtype=torch.float32).expand(3)[:, None]
    return (((p - torch.tensor(centre, dtype=torch.float32)[:, None]) / axes).norm(dim=1) - 1) * axes.min()


def limb(p: torch.Tensor, start: tuple, end: tuple, r: float) -> torch.Tensor:
    """Distance to a rod with round ends."""
    a, b = (torch.tensor(v, dtype=torch.float32)[:, None] for v in (start, end))
    t = (((p - a) * (b - a)).sum(1, keepdim=True) / ((b - a) ** 2).sum()).clamp(0, 1)
    return (p - a - t * (b - a)).norm(dim=1) - r


def joined(parts: list[torch.Tensor], width: float) -> torch.Tensor:
    """Smooth union."""
    return -width * torch.logsumexp(torch.stack([-d / width for d in parts]), 0)


def animal(p: torch.Tensor) -> torch.Tensor:
    """A smooth body whose legs, head and ears stand before one another."""
    p = turned(p, 35, 12)
    legs = [limb(p, (x, -0.2, z), (1.1 * x, -0.78, z), 0.1) for x in (-0.42, 0.42) for z in (-0.2, 0.2)]
    head = [ball(p, (0.72, 0.3, 0.0), (0.26, 0.2, 0.18)), limb(p, (0.45, 0.05, 0.0), (0.66, 0.28, 0.0), 0.14)]
    ears = [limb(p, (0.66, 0.42, s * 0.1), (0.62, 0.55, s * 0.24), 0.035) for s in (-1, 1)]
    tail = limb(p, (-0.62, 0.1, 0.0), (-0.82, -0.3, 0.06), 0.035)
    return joined([ball(p, (0.0, 0.0, 0.0), (0.68, 0.3, 0.31)), *legs, *head, *ears, tail], 0.03)


def lathe(p: torch.Tensor, outer: list, wall: float, floor: float, tilt_deg: float) -> torch.Tensor:
    """A vessel turned about its axis: radii at heights, hollow from `floor` up, its mouth towards the camera."""
    x, y, z = turned(p, 0, tilt_deg).unbind(1)
    r = (x * x + z * z + 1e-12).sqrt()
    at, radii = (torch.tensor(v) for v in zip(*outer, strict=True))
    k = torch.searchsorted(at, y.detach().contiguous()).clamp(1, len(at) - 1)
    t = ((y - at[k - 1]) / (at[k] - at[k - 1])).clamp(0, 1)
    t = t * t * (3 - 2 * t)
    profile = radii[k - 1] + t * (radii[k] - radii[k - 1])
    solid = torch.maximum(0.6 * (r - profile), torch.maximum(y - at[-1], at[0] - y))
    inside = joined([0.6 * (r - profile + wall), floor - y], -0.02)
    return torch.maximum(solid, -inside)


def goblet(p: torch.Tensor) -> torch.Tensor:
    """A cup on a thin stem on a foot, looked into a little."""
    outer = [(-0.95, 0.5), (-0.85, 0.42), (-0.7, 0.09), (-0.2, 0.08), (0.1, 0.42), (0.5, 0.5), (0.95, 0.45)]
    return lathe(p, outer, 0.05, 0.02, 25)


def bowl(p: torch.Tensor) -> torch.Tensor:
    """A deep bowl, looked into."""
    return lathe(p, [(-0.6, 0.3), (-0.4, 0.55), (0.1, 0.85), (0.6, 0.95)], 0.08, -0.5, 48)


def well(p: torch.Tensor) -> torch.Tensor:
    """A pot as deep as it is wide, of which only the mouth and the inside are seen."""
    return lathe(p, [(-0.9, 0.5), (-0.3, 0.75), (0.3, 0.7), (0.9, 0.9)], 0.1, -0.8, 75)


def group(p: torch.Tensor) -> torch.Tensor:
    """Fruit and stalks in a heap, far behind one another."""
    g = np.random.default_rng(4)
    balls = [ball(p, tuple(g.uniform(-0.7, 0.7, 3) * (1, 1, 1.8)), tuple(g.uniform(0.18, 0.38, 3))) for _ in range(16)]
    stalks = [limb(p, tuple(g.uniform(-0.8, 0.8, 3)), tuple(g.uniform(-0.8, 0.8, 3)), 0.04) for _ in range(5)]
    return joined([*balls, *stalks, ball(p, (0.0, 0.0, -1.4), (0.9, 0.9, 0.3))], 0.01)


def grid(p: torch.Tensor) -> torch.Tensor:
    """Thin bent rods before a rolling ground that they reach at both ends."""
    x, y, z = p.unbind(1)
    ground = 0.8 * (z + 0.5 - 0.12 * torch.sin(4 * x) * torch.cos(3 * y))
    frame = torch.maximum(torch.maximum(x.abs(), y.abs()) - 0.95, ground)
    rods = []
    for k in range(5):
        u = -0.7 + 0.35 * k
        height = -0.55 + 0.7 * torch.sqrt((1 - (y / 0.9) ** 2).clamp(min=1e-4))
        rods.append(0.6 * (((x - u - 0.05 * torch.sin(5 * y)) ** 2 + (z - height) ** 2 + 1e-12).sqrt() - 0.025))
    return joined([frame, *rods], 0.008)


def turned(p: torch.Tensor, turn_deg: float, tilt_deg: float) -> torch.Tensor:
    """Points in the frame of a solid that is turned about the upright axis, then tilted towards the camera."""
    a, b = np.radians([turn_deg, tilt_deg])
    upright = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return torch.tensor((tilt @ upright).T, dtype=torch.float32) @ p


SCENES = {"animal": animal, "goblet": goblet, "bowl": bowl, "well": well, "group": group, "grid": grid}


@dataclass(frozen=True)
class Rendered:
    """What the renderer asks of a solid."""

    distance: Callable[[torch.Tensor], torch.Tensor]

    def field(self) -> Callable[[torch.Tensor], torch.Tensor]:
        return self.distance


def scene(name: str, size: int, turn_deg: float = 0, tilt_deg: float = 0) -> tuple[pn.Normals, np.ndarray]:
    """The largest connected part of a rendered solid: exact normals, and heights in pixels (NaN elsewhere).

    It may be turned about the upright axis and tilted before that.
    """
    view = WindowView(torch.zeros(1, 2), torch.full((1,), 1.1), size)
    geometry = visible_surface(
        Rendered(lambda p: SCENES[name](turned(p, turn_deg, tilt_deg))), view, torch.full((1, size * size), REACH)
    )
    parts, _ = label(geometry.mask[0].numpy())
    mask = parts == np.bincount(parts[parts > 0]).argmax()
    n = geometry.normals[0].permute(1, 2, 0).numpy() * mask[..., None]
    return pn.Normals(n, mask), np.where(mask, geometry.height[0].double().numpy(), np.nan)
