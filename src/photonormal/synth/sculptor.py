"""Draws random solids: plain convex ones, blobs, figures, reliefs, machined and turned parts, piles, pleats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from photonormal.synth.params import log_uniform, rotations, tensor, unit_vectors
from photonormal.synth.shapes import FAR, Detail, Ellipsoids, Lathe, Solids
from photonormal.synth.waves import draw_waves

KINDS = ("plain", "blobs", "figure", "relief", "machined", "turned", "pile", "pleated")
PARTS, HOLES, CUTS = 10, 3, 3


def draw_solids(g: np.random.Generator, b: int, mix: tuple[float, ...], roughness: float = 1.0) -> Solids:
    """`b` solids; `mix` are the shares of KINDS, `roughness` scales all detail (0: smooth)."""
    kind = g.choice(len(KINDS), b, p=np.asarray(mix) / sum(mix))
    pleated = kind == KINDS.index("pleated")
    kind = np.where(pleated, KINDS.index("turned"), kind)
    plain, blobs, figure, relief, machined, turned, pile, _ = (kind == i for i in range(len(KINDS)))
    plain_lathe = plain & (g.random(b) < 0.3)
    lathe = turned | plain_lathe
    parts = _parts(g, b, kind, plain_lathe)
    holes = Ellipsoids(
        tensor(rotations(g, (b, HOLES)) / log_uniform(g, 0.2, [[0.5], [0.5], [0.9]], (b, HOLES, 3, 1))),
        tensor(unit_vectors(g, (b, HOLES)) * g.uniform(0.2, 0.8, (b, HOLES, 1)) * [1, 1, 0.4] + [0, 0, 0.5]),
        torch.full((b, HOLES), 2.0),
        torch.from_numpy(
            (g.random(b) < np.select([blobs, figure | relief, machined], [0.65, 0.45, 0.8], 0.0))[:, None]
            & (np.arange(HOLES) < g.integers(1, HOLES + 1, b)[:, None])
        ),
    )
    cutting = ((machined & (g.random(b) < 0.75)) | (blobs & (g.random(b) < 0.15)))[:, None]
    cutting = cutting & (np.arange(CUTS) < g.integers(1, CUTS + 1, b)[:, None])
    wall_n = g.normal(size=(b, 3)) * [0.28, 0.28, 0] + [0, 0, 1]
    wall = relief | (pile & (g.random(b) < 0.6)) | (figure & (g.random(b) < 0.25))
    blend = np.where(g.random(b) < 0.45, log_uniform(g, 0.008, 0.03, b), log_uniform(g, 0.03, 0.16, b))
    blend = np.where(pile, 0.008, blend)
    solids = Solids(
        parts,
        holes,
        _lathe(g, lathe, plain_lathe),
        tensor(np.where(lathe & ~turned, 0.01, blend)),
        tensor(unit_vectors(g, (b, CUTS))),
        tensor(np.where(cutting, g.uniform(0.1, 0.7, (b, CUTS)), 2 * FAR)),
        tensor(wall_n / np.linalg.norm(wall_n, axis=-1, keepdims=True)),
        tensor(np.where(wall, g.uniform(-0.85, -0.15, b), -2 * FAR)),
        tensor(np.where((machined | blobs) & (g.random(b) < 0.35), g.uniform(-2.2, 2.2, b), 0.0)),
        _detail(g, b, kind, roughness),
    )
    return _with_pleats(g, solids, pleated) if pleated.any() else solids


def _with_pleats(g: np.random.Generator, solids: Solids, on: np.ndarray) -> Solids:
    """Turned solids, of which those that are `on` get deep flutes, or folds over everything: bowls, pouches, cloth."""
    b, lathe, detail = len(on), solids.lathe, solids.detail
    fluted = on & (g.random(b) < 0.6)
    folded = on & ~fluted
    flutes = g.integers(8, 25, b)
    fold = log_uniform(g, 6, 16, b)
    direction = unit_vectors(g, (b,)) * [1, 0.4, 0.4]
    some = torch.from_numpy(folded)
    return replace(
        solids,
        lathe=replace(
            lathe,
            flutes=torch.where(torch.from_numpy(fluted), tensor(flutes.astype(float)), lathe.flutes),
            flute_depth=torch.where(
                torch.from_numpy(fluted), tensor(g.uniform(0.6, 1.8, b) / flutes), lathe.flute_depth
            ),
        ),
        detail=replace(
            detail,
            fold=torch.where(some, tensor(g.uniform(0.6, 1.4, b) / fold), detail.fold),
            fold_w=torch.where(some[:, None, None], tensor((direction * fold[:, None])[:, None]), detail.fold_w),
            patch=torch.where(some, torch.zeros(b), detail.patch),
        ),
    )


def _parts(g: np.random.Generator, b: int, kind: np.ndarray, none: np.ndarray) -> Ellipsoids:
    plain, blobs, figure, relief, machined, _, pile, _ = (kind == i for i in range(len(KINDS)))
    lone = plain[:, None]
    ball = lone & (g.random((b, 1)) < 0.4)
    size = np.where(
        lone, g.uniform(0.75, 1.0, (b, PARTS)), log_uniform(g, 0.22, np.where(pile, 0.42, 0.62)[:, None], (b, PARTS))
    )
    stretch = log_uniform(g, np.where(figure, 0.45, 0.65)[:, None, None], 1 / 0.65, (b, PARTS, 3))
    stretch[..., 1] *= np.where(figure[:, None], log_uniform(g, 1.0, 2.0, (b, PARTS)), 1)
    stretch = np.where(ball[..., None], 1, stretch)
    axes = size[..., None] * stretch
    turn = rotations(g, (b, PARTS))
    c = unit_vectors(g, (b, PARTS)) * (g.random((b, PARTS, 1)) ** 0.5 * 0.75)
    c[:, 0] *= 0.2
    c[relief] *= [1.2, 1.2, 0.5]
    c[figure] *= [0.75, 1.25, 0.95]
    c[pile] *= [1.25, 1.25, 1.0]
    c[plain] = 0
    count = np.select(
        [plain, blobs, figure | pile, relief, machined],
        [1, g.integers(3, PARTS, b), g.integers(6, PARTS + 1, b), g.integers(2, PARTS, b), g.integers(1, 5, b)],
        g.integers(0, 3, b),
    )
    count = np.where(none, 0, count)
    boxy = np.where(
        (machined[:, None] & (g.random((b, PARTS)) < 0.8))
        | (g.random((b, PARTS)) < np.where(pile & (g.random(b) < 0.4), 0.6, 0.05)[:, None]),
        g.choice([4.0, 8.0], (b, PARTS)),
        2.0,
    )
    boxy = np.where(lone, np.where(g.random((b, PARTS)) < 0.12, 4.0, 2.0), boxy)
    boxy = np.where(ball, 2.0, boxy)
    return Ellipsoids(
        tensor(turn / axes[..., None]),
        tensor(c),
        tensor(boxy),
        torch.from_numpy(np.arange(PARTS) < count[:, None]),
    )


def _lathe(g: np.random.Generator, on: np.ndarray, smooth: np.ndarray) -> Lathe:
    b = len(on)
    f = log_uniform(g, 1.5, 14.0, (b, 4))
    slope = np.where(smooth[:, None], 0.25, 0.5) * g.uniform(-1, 1, (b, 4))
    fluted = ~smooth & (g.random(b) < 0.3)
    hollow = ~smooth & (g.random(b) < 0.6)
    tilt = np.where(hollow, g.uniform(0.5, 1.2, b), g.normal(0, 0.6, b))  # towards the camera: into a bowl
    roll = g.uniform(0, 2 * np.pi, b)
    spin = np.where(hollow, g.normal(0, 0.5, b), roll)
    R = _about(2, spin) @ _about(0, tilt) @ _about(1, roll)  # own -> world
    return Lathe(
        tensor(R.transpose(0, 2, 1).copy()),
        tensor(g.uniform(0.45, 1.0, b)),
        tensor(np.where(hollow, g.uniform(0.6, 0.95, b), g.uniform(0.35, 0.9, b))),
        tensor(slope / f),
        tensor(f),
        tensor(g.uniform(0, 2 * np.pi, (b, 4))),
        tensor(g.integers(6, 25, b).astype(float)),
        tensor(np.where(fluted, g.uniform(0.02, 0.1, b), 0.0)),
        tensor(np.where(hollow, g.uniform(0.06, 0.15, b), 0.0)),
        torch.from_numpy(on),
    )


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    R = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[:, axis, axis] = 1
    R[:, i, i] = R[:, j, j] = np.cos(angle)
    R[:, j, i] = np.sin(angle)
    R[:, i, j] = -R[:, j, i]
    return R


def _detail(g: np.random.Generator, b: int, kind: np.ndarray, roughness: float) -> Detail:
    plain, _, figure, relief, _, turned, pile, _ = (kind == i for i in range(len(KINDS)))
    frequency = np.stack([log_uniform(g, 2.5, 6, b), log_uniform(g, 8, 20, b), log_uniform(g, 22, 45, b)], -1)
    scale = (
        roughness
        * np.where(plain, (g.random(b) < 0.15) * 0.3, 1.0)
        * np.where(g.random(b) < 0.15, 0.0, g.uniform(0.25, 0.9, b))
        * np.where(pile, 0.6, 1)
    )
    rich = 1 + 0.4 * (figure | relief)

    def sometimes(share: float, low: float, high: float) -> np.ndarray:
        """A slope of the displaced surface, zero in most scenes."""
        return scale * rich * (g.random(b) < share) * g.uniform(low, high, b)

    slope = np.stack([sometimes(0.7, 0.1, 0.65), sometimes(0.6, 0.08, 0.45), sometimes(0.35, 0.05, 0.3)], -1)
    slope[:, 0] *= np.where(turned, 0.3, 1)
    fold = log_uniform(g, 8, 26, b)
    direction = unit_vectors(g, (b,)) * [1, 0.5, 0.5]
    return Detail(
        draw_waves(g, frequency[:, 0:1], 1.3),
        draw_waves(g, frequency[:, 1:2], 1.3),
        draw_waves(g, frequency[:, 2:3], 1.0),
        tensor(slope / frequency),
        tensor(sometimes(0.22, 0.3, 0.9) * g.choice([-1, 1], b) / frequency[:, 1]),
        tensor(sometimes(0.2, 0.02, 0.06)),
        tensor(g.uniform(0.1, 0.35, b)),
        tensor(sometimes(0.15, 0.03, 0.12)),
        tensor(sometimes(0.2, 0.2, 0.6) / fold),
        tensor((direction * fold[:, None])[:, None]),
        tensor(g.random(b)),
        tensor(scale * (g.random(b) < 0.3)).clamp(max=1),
    )
