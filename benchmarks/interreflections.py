"""Albedo of matt objects whose parts light each other, before and after that light is taken out.

    python benchmarks/interreflections.py [--seeds 20 21] [--kinds bowl pit ...] [--method normalnet]

Mitsuba traces paths with five bounces (`pip install 'photonormal[synth]'`): bowls, pleats, an edge between two planes,
dents, a pit, a ring, a soft relief, a bowl of crumpled paper and a turtle, and a half sphere, whose parts light each
other nowhere. Albedos are from 0.1 to 0.9, half of the scenes are painted; 128 x 128 pixels, 24 lights, over the
hemisphere down to 20 degrees or within 45 of the view; white balance and exposure are drawn, noise is 0.3 % of full
scale, samples have 12 bits.

`hollow`: the share of pixels to which other parts add 5 % of the lamps' light or more; errors there, in per cent of
the albedo, median and 90th percentile, before and after; the same elsewhere. `worse`: how many pixels are off by a
hundredth more than before. `exposure`: what was found, over the true one, of green; - where nothing was told.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

import photonormal as pn
from photonormal.geometry import fibonacci_cap
from photonormal.materials.interreflections import brightening
from photonormal.methods import DEFAULT
from photonormal.methods.albedo import lambertian_albedo
from photonormal.synth.pathtraced import tracer
from photonormal.synth.pathtraced.meshes import Triangles
from photonormal.synth.pathtraced.objects import OBJECTS
from photonormal.types import Capture, Normals

KINDS = ("bowl", "pleats", "corner", "dents", "pit", "ring", "hemisphere", "relief", "paperbowl", "turtle")
SIZE, GRID, REACH = 128, 256, 1.15  # pixels of the pictures, points a side of height fields, half their side
HOLLOW = 0.05  # of the lamps' light, that other parts add


@dataclass(frozen=True)
class Scene:
    """A capture; its albedo in the unit of the images; where other parts add light; the true exposure."""

    capture: Capture
    albedo: np.ndarray
    known: np.ndarray
    hollow: np.ndarray
    exposure: np.ndarray


def waves(g: np.random.Generator, width: float) -> np.ndarray:
    """Smooth random heights of variance 1."""
    made = gaussian_filter(g.normal(size=(GRID, GRID)), width)
    return made / made.std()


def heights(kind: str, g: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y and z of a height field, NaN where there is nothing."""
    t = np.linspace(-REACH, REACH, GRID)
    x, y = np.meshgrid(t, -t)
    r = np.hypot(x, y)
    if kind == "bowl":
        a, depth = g.uniform(0.7, 0.98), g.uniform(0.5, 0.9)
        z = np.where(r < a, -depth * np.sqrt(np.clip(1 - (r / a) ** 2, 0, 1)), 0)
    elif kind == "pleats":
        k, angle = g.integers(2, 6), g.uniform(0, np.pi)
        u = x * np.cos(angle) + y * np.sin(angle)
        z = 0.88 * g.uniform(0.5, 1.2) / k * (2 * np.abs((u * k / 2) % 1 * 2 - 1) - 1)
    elif kind == "corner":
        angle = g.uniform(0, np.pi)
        u = x * np.cos(angle) + y * np.sin(angle)
        z = np.abs(u - g.uniform(-0.2, 0.2)) * np.tan(np.radians(g.uniform(30, 50)))
    elif kind == "dents":
        z = -0.25 * np.abs(waves(g, GRID / 10)) * g.uniform(0.7, 1.3) + 0.015 * waves(g, GRID / 30)
    elif kind == "pit":
        a, soft = g.uniform(0.4, 0.7), g.uniform(0.15, 0.3)
        z = -g.uniform(0.3, 0.6) / (1 + np.exp((np.maximum(abs(x), abs(y)) - a) / (soft / 4)))
    elif kind == "ring":
        z = 0.35 * np.exp(-(((r - 0.65) / g.uniform(0.12, 0.2)) ** 2)) * g.uniform(0.8, 1.5)
    elif kind == "hemisphere":
        z = np.where(r < 0.98, np.sqrt(np.clip(1 - r**2, 0, None)), np.nan)
    else:
        z = 0.06 * waves(g, GRID / 16) + 0.02 * waves(g, GRID / 40)
    return x, y, z


def mesh(kind: str, g: np.random.Generator) -> Triangles:
    if kind in ("turtle", "paperbowl"):
        return OBJECTS["bowl" if kind == "paperbowl" else kind](None)
    x, y, z = heights(kind, g)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    i = np.arange(GRID**2).reshape(GRID, GRID)
    a, b, c, d = (each.ravel() for each in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Triangles(np.nan_to_num(vertices), faces[np.isfinite(vertices[faces]).all((1, 2))])


def rendered(kind: str, seed: int) -> Scene:
    """A painted or plain object, seen with bounces."""
    g = np.random.default_rng([seed, KINDS.index(kind)])
    base = g.uniform(0.25, 0.9) * np.array([1, g.uniform(0.6, 1), g.uniform(0.4, 1)])
    painted = g.random() < 0.5
    made = mesh(kind, g)
    colour = np.repeat(base[None], len(made.vertices), 0)
    if painted:
        wave, phase = g.normal(0, 4, (3, 3)), g.uniform(0, 6, 3)
        colour = colour * (1 - 0.5 * (np.sin(made.vertices @ wave.T + phase) > 0) * g.uniform(0.2, 1, 3))
    colour = colour.clip(0.03, 0.95)
    made = Triangles(made.vertices, made.faces, made.normals, {"vertex_color": colour})
    reflectance = {"type": "mesh_attribute", "name": "vertex_color"}
    camera = tracer.OrthographicCamera(size=SIZE)
    scene = tracer.build(
        [made.shape({"type": "twosided", "of": {"type": "diffuse", "reflectance": reflectance}})], camera
    )
    seen = tracer.look(scene, camera)
    mask = seen.mask & tracer.covered(scene, camera)
    L = fibonacci_cap(24, 45.0 if g.random() < 0.5 else 20.0)
    full, direct = (tracer.trace(scene, camera, L, samples=64, bounces=k, seed=seed) for k in (5, 0))
    albedo, known = true_albedo(scene, camera, seen, L, direct)
    gain = g.uniform(0.5, 1.6) * np.array([g.uniform(0.7, 1.2), 1, g.uniform(0.6, 1.2)])
    gain *= 0.97 / np.quantile(full[:, mask] * gain, 0.999)
    noise = np.random.default_rng(seed)
    I = full * gain
    I = I + noise.normal(size=I.shape) * 0.003 * np.sqrt(I.clip(0.1, 1))
    I = np.rint(I.clip(0, 1) * 4095) / 4095 * mask[..., None]
    truth = Normals(np.where(mask[..., None], seen.normals, 0).astype(np.float32), mask)
    capture = Capture(I.astype(np.float32), mask, L, truth, np.ones((len(I), 3)), name=f"{kind} {seed}")
    added = (full - direct).sum((0, 3)) / np.maximum(direct.sum((0, 3)), 1e-9)
    return Scene(capture, albedo * gain, known & mask, added > HOLLOW, 1 / gain)


def true_albedo(scene: Any, camera: Any, seen: Any, L: np.ndarray, direct: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What direct light tells of each pixel's mean albedo, and where it does."""
    cos = np.einsum("nk,ijk->nij", L, seen.normals).clip(0)
    lit = cos * tracer.eroded(tracer.reached(scene, camera, L))
    total = (lit * cos).sum(0)
    return (lit[..., None] * direct).sum(0) / np.maximum(total, 1e-9)[..., None], total > 1e-3


def scored(scene: Scene, method: str) -> str:
    """A row of the table."""
    capture = scene.capture
    normals = pn.solve(capture, method)
    before = lambertian_albedo(capture, normals)
    found, after = brightening(capture, normals, pn.integrate(normals), before), before.copy()
    if found is not None:
        found.take_from(after)
    on = normals.mask & scene.known
    e0, e1 = (100 * (np.abs((a / scene.albedo.clip(1e-9) - 1)[on].mean(-1))) for a in (before, after))
    hollow = scene.hollow[on]

    def told(where: np.ndarray) -> str:
        if where.sum() < 30:
            return "| |"
        return "| " + " | ".join(f"{np.median(e[where]):.1f}, {np.quantile(e[where], 0.9):.1f}" for e in (e0, e1)) + " "

    exposure = "-" if found is None else f"{found.exposure[1] / scene.exposure[1]:.2f}"
    share, worse = 100 * hollow.mean(), 100 * (e1 > e0 + 1).mean()
    return f"| {capture.name} | {share:.0f} % {told(hollow)}{told(~hollow)}| {worse:.1f} % | {exposure} |"


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--seeds", type=int, nargs="+", default=[20, 21])
    words.add_argument("--kinds", choices=KINDS, nargs="+", default=KINDS)
    words.add_argument("--method", default=DEFAULT)
    asked = words.parse_args()
    print("| scene | hollow | there before | after | elsewhere before | after | worse | exposure |")
    print("|---|---|---|---|---|---|---|---|")
    for seed in asked.seeds:
        for kind in asked.kinds:
            print(scored(rendered(kind, seed), asked.method), flush=True)


if __name__ == "__main__":
    main()
