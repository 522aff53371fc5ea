"""Objects of the test scenes, built from numbers, and the statue from a folder of meshes: none is trained on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from photonormal.synth.meshes import STATUE
from photonormal.synth.params import rng
from photonormal.synth.pathtraced.compare import plain, solid
from photonormal.synth.pathtraced.meshes import Triangles, polygonise, read_mesh
from photonormal.synth.scene import draw_scenes
from photonormal.synth.sculptor import KINDS
from photonormal.types import InputError


def sphere(meshes: Path | None = None) -> Triangles:
    """The unit sphere with its exact normals."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=6)
    vertices = np.asarray(ball.vertices, np.float64)
    return Triangles(vertices, np.asarray(ball.faces), vertices / np.linalg.norm(vertices, axis=1, keepdims=True))


def turtle(meshes: Path | None = None) -> Triangles:
    """A turtle from above: a domed shell of plates, a rim, a head, four flippers and a tail."""
    g = np.random.default_rng(17)
    plates = g.uniform([-0.6, -0.75], [0.6, 0.75], (400, 2))
    for _ in range(30):  # apart from each other, about a regular pattern
        apart = plates[:, None] - plates[None, :26]
        near = np.linalg.norm(apart, axis=-1).argmin(1)
        plates[:26] = np.stack([plates[near == i].mean(0) if (near == i).any() else plates[i] for i in range(26)])
    plates = plates[:26]
    parts = [  # centre, semi-axes, turn about z in degrees
        ((0, 0.86, 0.02), (0.15, 0.2, 0.15), 0),
        ((-0.6, 0.5, -0.08), (0.38, 0.13, 0.07), -40),
        ((0.6, 0.5, -0.08), (0.38, 0.13, 0.07), 40),
        ((-0.5, -0.62, -0.08), (0.28, 0.12, 0.07), 45),
        ((0.5, -0.62, -0.08), (0.28, 0.12, 0.07), -45),
        ((0, -0.84, -0.06), (0.05, 0.14, 0.05), 0),
    ]

    def f(p: np.ndarray) -> np.ndarray:
        near = np.sort(np.linalg.norm(p[:, None, :2] - plates, axis=-1), 1)
        groove = 0.022 * np.exp(-(((near[:, 1] - near[:, 0]) / 0.03) ** 2))
        shell = _ellipsoid(p, (0, 0, -0.05), (0.6, 0.74, 0.42), 0) + groove + 0.02 * np.cos(9 * near[:, 0])
        shell = np.maximum(shell, -0.1 - p[:, 2])
        d = _union(shell, _ellipsoid(p, (0, 0, -0.08), (0.68, 0.82, 0.07), 0), 0.02)
        for part in parts:
            d = _union(d, _ellipsoid(p, *part), 0.03)
        return d

    tilt = np.radians(-18)
    R = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return polygonise(f, 1.2, 288).moved(R).fitted()


def bowl(meshes: Path | None = None) -> Triangles:
    """A bowl of folded, crumpled paper, seen into: pleats that open towards a wavy rim."""
    g = np.random.default_rng(23)
    turns, steps = 720, 120
    theta = np.arange(turns) * (2 * np.pi / turns)
    out = np.linspace(0, 1, steps)
    s = np.concatenate([out, out[::-1]])[:, None]  # up the outer side, down the inner one
    inner = np.repeat([0.0, 1.0], steps)[:, None]
    radius = 0.32 + 0.62 * s**1.3
    radius = np.where(s < 0.15, 0.32 * s / 0.15 + 0.62 * s**1.3, radius)
    height = np.clip((s - 0.12) / 0.88, 0, None) * 0.75
    pleats = np.abs(((theta * 22 / (2 * np.pi)) % 1) * 2 - 1) - 0.5
    fold = 0.11 * pleats * np.clip(s - 0.12, 0, None)
    w, phase = g.normal(0, 7, (10, 3)), g.uniform(0, 2 * np.pi, 10)
    ring = np.stack([np.cos(theta) * s, np.sin(theta) * s, 0 * theta + 0 * s], -1)
    creases = (np.abs(np.sin(ring @ w.T + phase)) - 0.64).sum(-1) * 0.014 * np.clip(s * 3, 0, 1)
    r = np.clip(radius + fold + creases - 0.035 * inner * np.clip(s * 8, 0, 1), 1e-4, None)
    z = height + 0.6 * creases + 0.035 * inner * np.clip(1 - s, 0, 1) + 0.05 * s**4 * np.sin(3 * theta + 1)
    vertices = np.stack([r * np.cos(theta), r * np.sin(theta), z + 0 * r], -1)  # (2 steps, turns, 3)
    i, j = np.meshgrid(np.arange(2 * steps - 1), np.arange(turns), indexing="ij")
    a, b = i * turns + j, i * turns + (j + 1) % turns
    faces = np.stack([a, b, b + turns, a, b + turns, a + turns], -1).reshape(-1, 3)
    tilt = np.radians(-38)
    R = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return Triangles(vertices.reshape(-1, 3), faces).moved(R).fitted()


def statue(meshes: Path | None = None) -> Triangles:
    """The bust of Nefertiti from a folder of meshes."""
    if meshes is None or not (meshes / STATUE).is_file():
        raise InputError(f"{meshes} holds no {STATUE} but the statue is made from it; give the folder of meshes.")
    return read_mesh(meshes / STATUE).fitted()


def pleated(seed: int) -> Callable[[Path | None], Triangles]:
    """Makes a pouch, bowl or cloth in pleats, drawn from a seed that no training uses."""

    def made(meshes: Path | None = None) -> Triangles:
        drawn = plain(shapes=tuple(float(kind == "pleated") for kind in KINDS))
        return solid(draw_scenes(drawn, rng(seed, 9), 1, 3, None).solids, 192).fitted()

    return made


OBJECTS: dict[str, Callable[[Path | None], Triangles]] = {
    "sphere": sphere, "turtle": turtle, "bowl": bowl, "statue": statue,
    "flutes": pleated(11), "crumple": pleated(12), "folds": pleated(16), "pouch": pleated(21),
}  # fmt: skip


def _ellipsoid(p: Float[np.ndarray, "p 3"], c: tuple, axes: tuple, turn_deg: float | int) -> Float[np.ndarray, " p"]:
    t = np.radians(turn_deg)
    q = (p - np.array(c)) @ np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])
    r = np.linalg.norm(q / np.array(axes), axis=1) + 1e-9
    return r * (r - 1) / (np.linalg.norm(q / np.array(axes) ** 2, axis=1) + 1e-9)


def _union(a: np.ndarray, b: np.ndarray, k: float) -> np.ndarray:
    """Minimum of two distances with a fillet of about `k`."""
    h = np.clip(0.5 + 0.5 * (b - a) / k, 0, 1)
    return b + h * (a - b) - k * h * (1 - h)
