"""Random sets of light directions: hemispheres, cones, the flat grid of a light stage, rings and domes."""

from __future__ import annotations

import numpy as np

from photonormal.types import InputError

LOWEST = 0.08  # lz of the lowest light of a hemisphere


def draw_lights(g: np.random.Generator, b: int, n: int, narrow: float, rig: str = "mixed") -> np.ndarray:
    """Unit directions (b, n, 3); the share `narrow` of the sets is about as narrow as DiLiGenT's, the rest wide.

    A `rig` other than "mixed" is one of KINDS for all of them.
    """
    if rig != "mixed" and rig not in _KINDS:
        raise InputError(f"no light rig {rig!r}; use mixed, {', '.join(_KINDS)}.")
    sets = []
    for _ in range(b):
        if rig != "mixed":
            kind = rig
        elif g.random() < narrow:
            kind = g.choice(["grid", "box", "cone"], p=[0.5, 0.3, 0.2])
        else:
            kind = g.choice(["hemisphere", "cone", "dome", "rings"], p=[0.6, 0.15, 0.15, 0.1])
        sets.append(_KINDS[kind](g, n))
    l = np.stack(sets)
    return l / np.linalg.norm(l, axis=-1, keepdims=True)


def hemisphere(g: np.random.Generator, n: int, lowest: float = LOWEST) -> np.ndarray:
    """Uniform over directions above `lowest`."""
    z, phi = g.uniform(lowest, 1, n), g.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


def cone(g: np.random.Generator, n: int) -> np.ndarray:
    """Within 25 to 55 degrees of an axis near the view."""
    l = hemisphere(g, n, float(np.cos(np.radians(g.uniform(25, 55)))))
    l[:, :2] += g.normal(0, 0.06, 2)
    return _above(l)


def box(g: np.random.Generator, n: int) -> np.ndarray:
    """lx and ly uniform over a rectangle, lz at least about 0.7."""
    a = g.uniform(0.4, 0.62), g.uniform(0.3, 0.55)
    xy = g.uniform(-1, 1, (n, 2)) * (a if g.random() < 0.5 else a[::-1])
    xy *= np.minimum(1, 0.714 / np.linalg.norm(xy, axis=-1, keepdims=True))
    return np.concatenate([xy, np.sqrt(1 - (xy**2).sum(-1, keepdims=True))], -1)


def grid(g: np.random.Generator, n: int) -> np.ndarray:
    """Lamps on a flat frame around the camera, like DiLiGenT's 12 x 8: `n` jittered points of the grid."""
    columns, rows = 12, 8
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-1, 1, rows))
    xy = np.stack([x.ravel(), y.ravel()], -1)
    pick = g.permutation(len(xy)) if n <= len(xy) else g.integers(0, len(xy), n)
    xy = xy[pick[:n]] + g.normal(0, 0.03 if n <= len(xy) else 0.12, (n, 2))
    xy *= [g.uniform(0.65, 0.8), g.uniform(0.4, 0.55)]
    if g.random() < 0.3:
        xy = xy[:, ::-1]
    return _above(np.concatenate([xy + g.normal(0, 0.03, 2), np.ones((n, 1))], -1), 0.0)


def dome(g: np.random.Generator, n: int) -> np.ndarray:
    """Evenly over the hemisphere (a Fibonacci spiral), turned and jittered."""
    k = np.arange(n) + 0.5
    z = 1 - k / n * (1 - g.uniform(LOWEST, 0.4))
    phi = np.pi * (1 + 5**0.5) * k + g.uniform(0, 2 * np.pi)
    r = np.sqrt(1 - z**2)
    l = np.stack([r * np.cos(phi), r * np.sin(phi), z], -1) + g.normal(0, 0.02, (n, 3))
    return _above(l[g.permutation(n)])


def stage(g: np.random.Generator, n: int) -> np.ndarray:
    """The front of a light stage: an even, slightly irregular spiral down to 25 degrees above the horizon."""
    k = np.arange(n) + 0.5
    z = 1 - k / n * (1 - np.sin(np.radians(25)))
    r, phi = np.sqrt(1 - z**2), np.pi * (1 + 5**0.5) * k
    return _above(np.stack([r * np.cos(phi), r * np.sin(phi), z], -1) + g.normal(0, 0.015, (n, 3)))


def rings(g: np.random.Generator, n: int) -> np.ndarray:
    """Two or three rings of lamps at fixed elevations."""
    levels = np.sort(g.uniform(0.2, 0.92, g.integers(2, 4)))
    z = levels[np.arange(n) % len(levels)] + g.normal(0, 0.01, n)
    phi = 2 * np.pi * (np.arange(n) / n + g.uniform()) + g.normal(0, 0.02, n)
    r = np.sqrt(1 - z.clip(-1, 1) ** 2)
    return _above(np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)[g.permutation(n)])


def _above(l: np.ndarray, lowest: float = LOWEST) -> np.ndarray:
    l = l / np.linalg.norm(l, axis=-1, keepdims=True)
    l[:, 2] = l[:, 2].clip(min=lowest)
    return l


_KINDS = {
    "hemisphere": hemisphere,
    "cone": cone,
    "box": box,
    "grid": grid,
    "dome": dome,
    "stage": stage,
    "rings": rings,
}
KINDS = tuple(_KINDS)
