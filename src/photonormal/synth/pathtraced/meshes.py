"""Triangle meshes for Mitsuba: of an implicit surface, from an OBJ file, or built from numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from photonormal.files.opening import reason_of
from photonormal.synth.pathtraced.variant import mitsuba
from photonormal.types import InputError

Values = Callable[[np.ndarray], np.ndarray]  # points (p, 3) -> values (p,), negative inside
COARSE, STRIDE = 48, 4  # points a side of the first grid; steps of the last one between points of the second


@dataclass(frozen=True)
class Triangles:
    """Triangles, seen from outside counter-clockwise, with unit normals and named attributes of the vertices."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None = None  # None: means of the faces' around each vertex
    attributes: dict[str, np.ndarray] = field(default_factory=dict)  # "vertex_..." (v, k) or "face_..." (f, k)

    def shape(self, material: Any) -> Any:
        """The mesh as a Mitsuba shape of one material (a dictionary or an object)."""
        mi = mitsuba()
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict(material) if isinstance(material, dict) else material
        made = mi.Mesh("mesh", len(self.vertices), len(self.faces), has_vertex_normals=True, props=properties)
        normals = self.smooth_normals() if self.normals is None else self.normals
        parameters = mi.traverse(made)
        for name, values in (("vertex_positions", self.vertices), ("vertex_normals", normals)):
            parameters[name] = mi.Float(values.astype(np.float32).ravel()) if _many(mi) else values.ravel().tolist()
        parameters["faces"] = (
            mi.UInt32(self.faces.astype(np.uint32).ravel()) if _many(mi) else self.faces.ravel().tolist()
        )
        parameters.update()
        for name, values in self.attributes.items():
            made.add_attribute(name, values.shape[1], values.astype(np.float32).ravel())
        return made

    def smooth_normals(self) -> Float[np.ndarray, "v 3"]:
        """Unit normals of the vertices: means of the faces' weighted by area."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        n = np.cross(b - a, c - a)
        total = np.stack(
            [np.bincount(self.faces.ravel(), np.repeat(n[:, i], 3), len(self.vertices)) for i in range(3)], 1
        )
        return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)

    def moved(self, R: Float[np.ndarray, "3 3"], shift: Any = (0.0, 0.0, 0.0)) -> Triangles:
        """Turned by `R`, then shifted."""
        normals = None if self.normals is None else self.normals @ R.T
        return Triangles(self.vertices @ R.T + np.asarray(shift), self.faces, normals, self.attributes)

    def fitted(self, radius: float = 1.0) -> Triangles:
        """Centred on the origin and scaled so that its widest extent along x or y is 2 `radius`."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        scale = 2 * radius / (high - low)[:2].max()
        return Triangles((self.vertices - (low + high) / 2) * scale, self.faces, self.normals, self.attributes)

    def centres(self) -> Float[np.ndarray, "f 3"]:
        """Middles of the faces."""
        return self.vertices[self.faces].mean(1)


def _many(mi: Any) -> bool:
    return not str(mi.variant()).startswith("scalar")


def joined(meshes: list[Triangles]) -> Triangles:
    """Several closed meshes as one; they may overlap."""
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes])
    normals = [m.smooth_normals() if m.normals is None else m.normals for m in meshes]
    return Triangles(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=False)]),
        np.concatenate(normals),
    )


def read_mesh(path: Path) -> Triangles:
    """An OBJ, PLY, STL or OFF file, its faces turned outwards.

    Raises
    ------
    InputError
        If the file can't be read, has no faces, or holds numbers that are not finite.
    """
    import trimesh

    try:
        loaded: Any = trimesh.load(path, force="mesh", process=True)
    except Exception as error:  # loaders raise anything on a damaged file
        raise InputError(
            f"mesh {path} can't be read ({reason_of(error)}); give an OBJ or PLY file with triangles."
        ) from None
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    if not len(loaded.faces):
        raise InputError(f"mesh {path} has no faces but at least one is needed; export it as triangles.")
    vertices, faces = np.asarray(loaded.vertices, np.float64), np.asarray(loaded.faces)
    if not np.isfinite(vertices).all():
        raise InputError(f"mesh {path} has vertices that are not finite; export it again.")
    a, b, c = (vertices[faces[:, i]] - vertices.mean(0) for i in range(3))
    if (a * np.cross(b, c)).sum() < 0:  # inside out
        faces = faces[:, ::-1]
    return Triangles(vertices, np.ascontiguousarray(faces))


def polygonise(f: Values, reach: float, n: int) -> Triangles:
    """The surface f = 0 inside the cube |x|, |y|, |z| <= reach, on a grid of n cells along its longest side.

    `f` is about a distance: a coarse grid finds the box that holds the surface, and the parts of the fine grid that are
    near enough to it to be looked at. The cube closes what it cuts.
    """
    axis = np.linspace(-reach, reach, COARSE)
    F, h = _values(f, [axis] * 3), axis[1] - axis[0]
    low, high = (np.stack([i.min() if k == 0 else i.max() for i in np.nonzero(h * 1.2 > F)]) for k in (0, 1))
    low, high = axis[np.maximum(low - 1, 0)], axis[np.minimum(high + 1, COARSE - 1)]
    h = float((high - low).max() / n)
    cells = -(-((high - low) / h).round().astype(int) // STRIDE) * STRIDE
    axes = [low[i] + h * np.arange(cells[i] + 1) for i in range(3)]
    F = _values(f, [a[::STRIDE] for a in axes])
    index = [np.minimum((np.arange(len(a)) + STRIDE // 2) // STRIDE, F.shape[i] - 1) for i, a in enumerate(axes)]
    values = F[np.ix_(*index)]
    i, j, k = np.nonzero((np.abs(F) < 1.2 * STRIDE * h)[np.ix_(*index)])
    values[i, j, k] = f(np.stack([axes[0][i], axes[1][j], axes[2][k]], -1))
    for side in range(3):
        edge = np.moveaxis(values, side, 0)
        edge[0], edge[-1] = np.maximum(edge[0], 1e-4), np.maximum(edge[-1], 1e-4)
    return _nets(values, low, h)


def _values(f: Values, axes: list[np.ndarray]) -> np.ndarray:
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    return f(points.reshape(-1, 3)).reshape(points.shape[:3]).astype(np.float32)


def _nets(values: np.ndarray, low: np.ndarray, h: float) -> Triangles:
    """Naive surface nets: each cell that the surface crosses has one vertex, the mean of its edges' crossings."""
    inside = values < 0
    shape = tuple(n - 1 for n in values.shape)
    quads, points = [], []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        v, s = (np.moveaxis(x, (a, b, c), (0, 1, 2)) for x in (values, inside))
        i, j, k = np.nonzero(s[:-1] != s[1:])  # edges along a that the surface crosses
        v0, v1 = v[i, j, k], v[i + 1, j, k]
        at = np.zeros((len(i), 3), np.float32)  # in grid steps
        at[:, a], at[:, b], at[:, c] = i + v0 / (v0 - v1), j, k
        corners = []
        for dj, dk in ((-1, -1), (0, -1), (0, 0), (-1, 0)):  # the four cells around the edge
            cell = np.zeros((len(i), 3), np.int64)
            cell[:, a], cell[:, b], cell[:, c] = i, (j + dj).clip(0), (k + dk).clip(0)
            corners.append(np.ravel_multi_index(tuple(cell.T), shape, mode="clip"))
        quad = np.stack(corners, 1)
        quads.append(np.where(s[:-1][i, j, k][:, None], quad, quad[:, ::-1]))
        points.append(np.repeat(at[:, None], 4, 1))
    quad = np.concatenate(quads)
    used, inverse = np.unique(quad, return_inverse=True)
    quad = inverse.reshape(quad.shape)
    point = np.concatenate(points).reshape(-1, 3)
    total = np.stack([np.bincount(inverse.ravel(), point[:, i], len(used)) for i in range(3)], 1)
    vertices = low + h * total / np.bincount(inverse.ravel(), minlength=len(used))[:, None]
    return Triangles(vertices, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]))
