"""Paths of light under many distant lights at once, traced by Mitsuba.

A path from the camera meets the surface at a few vertices, whatever the lights are. Each vertex is asked for what every
light sends from it, one shadow ray a light; a stock integrator would trace the path again for every light.

Frame: x right, y up, z towards the orthographic camera. A white matt surface that faces a light has the value 1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from photonormal.synth.pathtraced.variant import mitsuba, vectorised

FAR = 50.0  # where camera rays begin
PATHS = 2**19  # paths traced at a time


@dataclass(frozen=True)
class OrthographicCamera:
    """A square orthographic window of `size` pixels around (x, y), `half` units of length to each side."""

    x: float = 0.0
    y: float = 0.0
    half: float = 1.0
    size: int = 128

    @property
    def pixel(self) -> float:
        """Side of a pixel in units of length."""
        return 2 * self.half / self.size

    def rays(self, index: Any, dx: Any = 0.5, dy: Any = 0.5) -> Any:
        """Rays through pixels (row * size + column), at a place inside each pixel."""
        mi = mitsuba()
        column, row = mi.Float(index % self.size), mi.Float(index // self.size)
        x, y = self.x - self.half + (column + dx) * self.pixel, self.y + self.half - (row + dy) * self.pixel
        return mi.Ray3f(mi.Point3f(x, y, FAR), mi.Vector3f(0, 0, -1))


@dataclass(frozen=True)
class CameraHits:
    """What the camera meets at the pixels' centres."""

    mask: Bool[np.ndarray, "s s"]
    normals: Float[np.ndarray, "s s 3"]  # unit, zero outside
    points: Float[np.ndarray, "s s 3"]


def eroded(mask: Bool[np.ndarray, "*n s s"]) -> Bool[np.ndarray, "*n s s"]:
    """Pixels that are set together with their eight neighbours."""
    s = mask.shape[-1]
    around = np.pad(mask, [(0, 0)] * (mask.ndim - 2) + [(1, 1), (1, 1)])
    return np.logical_and.reduce([around[..., i : i + s, j : j + s] for i in range(3) for j in range(3)])


def build(shapes: list[Any], camera: OrthographicCamera) -> Any:
    """A Mitsuba scene of some shapes, with a stock camera and one distant light, named `light`."""
    mi = mitsuba()
    view = mi.ScalarTransform4f().look_at(
        origin=[camera.x, camera.y, FAR], target=[camera.x, camera.y, 0], up=[0, 1, 0]
    )
    film = {"type": "hdrfilm", "width": camera.size, "height": camera.size, "pixel_format": "rgb",
            "component_format": "float32", "rfilter": {"type": "box"}}  # fmt: skip
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "orthographic",
                "to_world": view @ mi.ScalarTransform4f().scale([camera.half, camera.half, 1]),
                "near_clip": 0.01,
                "far_clip": 4 * FAR,
                "film": film,
            },
            "light": {"type": "directional", "direction": [0, 0, -1], "irradiance": {"type": "rgb", "value": math.pi}},
            **{f"shape_{i}": shape for i, shape in enumerate(shapes)},
        }
    )


def look(scene: Any, camera: OrthographicCamera) -> CameraHits:
    """Mask, shading normals and points at the pixels' centres."""
    s = camera.size
    mask, normals, points = np.zeros(s * s, bool), np.zeros((s * s, 3)), np.zeros((s * s, 3))
    for where, si in _first(scene, camera):
        mask[where] = np.array(si.is_valid())
        normals[where] = np.array(si.sh_frame.n).T
        points[where] = np.array(si.p).T
    mask &= normals[:, 2] > 0.01
    keep = mask[:, None]
    return CameraHits(
        mask.reshape(s, s), np.where(keep, normals, 0).reshape(s, s, 3), np.where(keep, points, 0).reshape(s, s, 3)
    )


def behind(scene: Any, camera: OrthographicCamera) -> Float[np.ndarray, "2 s s"]:
    """z where rays through the pixels' centres leave the solid they met, and where they enter it again, or -inf."""
    mi = mitsuba()
    z = np.full((2, camera.size**2), -np.inf)
    for where, si in _first(scene, camera):
        for crossing in z:
            si = scene.ray_intersect(si.spawn_ray(mi.Vector3f(0, 0, -1)), si.is_valid())
            crossing[where] = np.where(np.array(si.is_valid()), np.array(si.p.z), -np.inf)
    return z.reshape(2, camera.size, camera.size)


def covered(scene: Any, camera: OrthographicCamera) -> Bool[np.ndarray, "s s"]:
    """Pixels that the object fills: their corners, too, meet it."""
    mask = np.ones(camera.size**2, bool)
    for dx in (0.02, 0.98):
        for dy in (0.02, 0.98):
            for where, si in _first(scene, camera, dx, dy):
                mask[where] &= np.array(si.is_valid())
    return mask.reshape(camera.size, camera.size)


def reached(scene: Any, camera: OrthographicCamera, L: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n s s"]:
    """Where each light reaches what the camera meets at the pixels' centres: no part of the surface is in between."""
    mi = mitsuba()
    s = camera.size
    out = np.zeros((len(L), s * s), bool)
    for where, si in _first(scene, camera):
        for j, l in enumerate(L.tolist()):
            d = mi.Vector3f(*l)
            free = si.is_valid() & (si.sh_frame.n @ d > 0) & (si.n @ d > 0)
            out[j, where] = np.array(free & ~_blocked(scene, si.spawn_ray(d), free))
    return out.reshape(-1, s, s)


def _blocked(scene: Any, ray: Any, active: Any) -> Any:
    return scene.ray_test(ray, active) if vectorised() or active else False


def _first(scene: Any, camera: OrthographicCamera, dx: float = 0.5, dy: float = 0.5) -> Iterator[tuple[Any, Any]]:
    """Where the rays of all pixels, or of one after the other, arrive."""
    mi = mitsuba()
    every = camera.size**2
    if vectorised():
        import drjit as dr

        yield slice(None), scene.ray_intersect(camera.rays(dr.arange(mi.UInt32, every), dx, dy))
        return
    for i in range(every):
        yield i, scene.ray_intersect(camera.rays(i, dx, dy))


def trace(
    scene: Any,
    camera: OrthographicCamera,
    L: Float[np.ndarray, "n 3"],
    samples: int = 16,
    bounces: int = 0,
    seed: int = 0,
    centred: bool = False,
    bound: float = math.inf,
) -> Float[np.ndarray, "n s s 3"]:
    """Images under each light, a mean over paths through each pixel.

    Parameters
    ----------
    bounces : how often light may pass between surfaces before it leaves for the camera; 0: direct light only
    centred : all paths start at their pixel's centre instead of all over the pixel
    bound : most that one path's bounced light counts, against single bright pixels
    """
    if not vectorised():
        return np.stack([stock(scene, l, samples, bounces, seed + 1000 * j) for j, l in enumerate(L)])
    import drjit as dr

    mi = mitsuba()
    n, pixels = len(L), camera.size**2
    image = dr.zeros(mi.Float, pixels * n * 3)
    lights = mi.Vector3f(np.ascontiguousarray(L.T, np.float32))
    dr.eval(lights)
    batch = max(1, PATHS // pixels)
    for first in range(0, samples, batch):
        lane = dr.arange(mi.UInt32, pixels * min(batch, samples - first))
        pixel, number = lane % pixels, lane // pixels + first
        dx = dy = mi.Float(0.5)
        if not centred:  # a sequence that fills the pixel evenly
            k = mi.Float(number + 1)
            dx, dy = 0.5 + 0.7548776662 * k, 0.5 + 0.5698402910 * k
            dx, dy = dx - dr.floor(dx), dy - dr.floor(dy)
        _add_paths(image, scene, camera.rays(pixel, dx, dy), pixel, number, lights, bounces, (seed, first), bound)
    planes = np.array(image).reshape(n, 3, camera.size, camera.size)
    return np.ascontiguousarray(planes.transpose(0, 2, 3, 1)) / samples


def _add_paths(
    image: Any,
    scene: Any,
    ray: Any,
    pixel: Any,
    number: Any,
    lights: Any,
    bounces: int,
    seeds: tuple[int, int],
    bound: float,
) -> None:
    """One path for each ray, the `number`-th of its pixel, added to its pixel of `image` (n, 3, pixels)."""
    import drjit as dr

    mi = mitsuba()
    context = mi.BSDFContext()
    si = scene.ray_intersect(ray)
    hit: Any = dr.compress(si.is_valid())
    if dr.width(hit) == 0:
        return
    ray, pixel, number = (
        dr.gather(kind, x, hit) for kind, x in ((mi.Ray3f, ray), (mi.UInt32, pixel), (mi.UInt32, number))
    )
    seed, first = seeds
    sampler_seed = seed + 104729 * first
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(sampler_seed, dr.width(pixel))
    carried = dr.full(mi.Color3f, math.pi, dr.width(pixel))  # pi: irradiance of a light whose white is 1
    for k in range(bounces + 1):
        si = scene.ray_intersect(ray)
        active = si.is_valid() & (si.wi.z > 0)
        dr.eval(si, carried, active, pixel)
        _add_lights(image, scene, si, carried, active, pixel, lights, bound if k else math.inf)
        if k == bounces:
            return
        u1, u2 = sampler.next_1d(active), sampler.next_2d(active)
        if k == 0:  # spread evenly over the paths of a pixel
            shift = mi.sample_tea_float32(pixel, seed), mi.sample_tea_float32(pixel, seed + 1)
            turns = [mi.Float(number) * a for a in (0.8191725134, 0.6710436067, 0.5497004779)]
            third = mi.sample_tea_float32(pixel, seed + 2)
            u1, x, y = (t + s - dr.floor(t + s) for t, s in zip(turns, (third, *shift), strict=True))
            u2 = mi.Point2f(x, y)
        bs, weight = si.bsdf().sample(context, si, u1, u2, active)
        carried = carried * weight
        ray = si.spawn_ray(si.to_world(bs.wo))
        active &= dr.max(carried) > 0
        if k >= 1:  # half of the paths stand for all
            active &= sampler.next_1d(active) < 0.5
            carried = carried * 2
        alive: Any = dr.compress(active)
        if dr.width(alive) == 0:
            return
        carried, ray, pixel = (
            dr.gather(mi.Color3f, carried, alive), dr.gather(mi.Ray3f, ray, alive), dr.gather(mi.UInt32, pixel, alive)
        )  # fmt: skip
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(sampler_seed + 7919 * (k + 1), dr.width(alive))


def _add_lights(
    image: Any, scene: Any, si: Any, carried: Any, active: Any, pixel: Any, lights: Any, bound: float
) -> None:
    """What every light sends on from one vertex of each path."""
    import drjit as dr

    mi = mitsuba()
    context, bsdf, n = mi.BSDFContext(), si.bsdf(), dr.width(lights)
    pixels = dr.width(image) // (3 * n)

    def light(j: Any) -> Any:
        d = dr.gather(mi.Vector3f, lights, j)
        f = bsdf.eval(context, si, si.to_local(d), active)
        on = active & (dr.max(f) > 0) & (dr.dot(si.n, d) > 0)
        on &= ~scene.ray_test(si.spawn_ray(d), on)
        value = dr.minimum(f * carried, bound)
        for c in range(3):
            dr.scatter_add(image, value[c], (j * 3 + c) * pixels + pixel, on)
        return (j + 1,)

    last = dr.opaque(mi.UInt32, n)
    dr.while_loop((dr.zeros(mi.UInt32, dr.width(si)),), lambda j: j < last, light, labels=("j",))
    dr.eval(image)


def stock(
    scene: Any, light: Float[np.ndarray, " 3"], samples: int = 16, bounces: int = 0, seed: int = 0
) -> Float[np.ndarray, "s s 3"]:
    """The image under one light by Mitsuba's own integrator `path`, a mean over each pixel."""
    mi = mitsuba()
    up = [1, 0, 0] if abs(light[2]) > 0.9 else [0, 0, 1]
    parameters = mi.traverse(scene)
    parameters["light.to_world"] = mi.Transform4f().look_at(origin=[0, 0, 0], target=(-light).tolist(), up=up)
    parameters.update()
    path = mi.load_dict({"type": "path", "max_depth": bounces + 2, "rr_depth": 1000})
    return np.array(mi.render(scene, integrator=path, spp=samples, seed=seed))
