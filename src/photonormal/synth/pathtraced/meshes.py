"""Triangle meshes for Mitsuba: of an implicit surface, from an OBJ file, or built from numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from photonormal.synth.pathtraced.variant import mitsuba
from photonormal.types import InputError

Values = Callable[[np.ndarray], np.ndarray]  # points (p, 3) -> values (p,), negative inside
STRIDE = 4  # grid steps between the points that decide where the grid is looked at closely


@dataclass(frozen=True)
class Mesh:
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

    def moved(self, R: Float[np.ndarray, "3 3"], shift: Any = (0.0, 0.0, 0.0)) -> Mesh:
        """Turned by `R`, then shifted."""
        normals = None if self.normals is None else self.normals @ R.T
        return Mesh(self.vertices @ R.T + np.asarray(shift), self.faces, normals, self.attributes)

    def fitted(self, radius: float = 1.0) -> Mesh:
        """Centred on the origin and scaled so that its widest extent along x or y is 2 `radius`."""
        low, high = self.vertices.min(0), self.vertices.max(0)
        scale = 2 * radius / (high - low)[:2].max()
        return Mesh((self.vertices - (low + high) / 2) * scale, self.faces, self.normals, self.attributes)

    def centres(self) -> Float[np.ndarray, "f 3"]:
        """Middles of the faces."""
        return self.vertices[self.faces].mean(1)


def _many(mi: Any) -> bool:
    return not str(mi.variant()).startswith("scalar")


def joined(meshes: list[Mesh]) -> Mesh:
    """Several closed meshes as one; they may overlap."""
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes])
    normals = [m.smooth_normals() if m.normals is None else m.normals for m in meshes]
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=False)]),
        np.concatenate(normals),
    )


def read_mesh(path: Path) -> Mesh:
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
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(
            f"mesh {path} can't be read ({reason[:200]}); give an OBJ or PLY file with triangles."
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
    return Mesh(vertices, np.ascontiguousarray(faces))


def polygonise(f: Values, reach: float, n: int) -> Mesh:
    """The surface f = 0 inside the cube |x|, |y|, |z| <= reach, by a grid of n cells a side (naive surface nets).

    Each cell that the surface crosses has one vertex, the mean of where its edges are crossed. `f` is about a distance:
    the grid is only looked at closely where a coarse one is nearer to the surface than its own diagonal.
    """
    n = -(-n // STRIDE) * STRIDE
    axis = np.linspace(-reach, reach, n + 1).astype(np.float32)
    h = float(axis[1] - axis[0])
    coarse = axis[::STRIDE]
    F = f(np.stack(np.meshgrid(coarse, coarse, coarse, indexing="ij"), -1).reshape(-1, 3)).reshape((len(coarse),) * 3)
    near = np.abs(F) < 1.8 * STRIDE * h
    index = np.minimum((np.arange(n + 1) + STRIDE // 2) // STRIDE, len(coarse) - 1)
    values = F[np.ix_(index, index, index)].astype(np.float32)
    close = near[np.ix_(index, index, index)]
    i, j, k = np.nonzero(close)
    values[i, j, k] = f(np.stack([axis[i], axis[j], axis[k]], -1))
    for side in range(3):  # closed where the cube cuts it
        edge = np.moveaxis(values, side, 0)
        edge[0], edge[-1] = np.maximum(edge[0], 1e-4), np.maximum(edge[-1], 1e-4)
    return _nets(values, axis, h)


def _nets(values: np.ndarray, axis: np.ndarray, h: float) -> Mesh:
    """Surface nets of values on a grid."""
    inside = values < 0
    n = len(axis) - 1
    total, count = np.zeros((n, n, n, 3), np.float32), np.zeros((n, n, n), np.int32)
    quads = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        v, s = np.moveaxis(values, (a, b, c), (0, 1, 2)), np.moveaxis(inside, (a, b, c), (0, 1, 2))
        i, j, k = np.nonzero(s[:-1] != s[1:])  # edges along a that the surface crosses
        v0, v1 = v[i, j, k], v[i + 1, j, k]
        at = np.zeros((len(i), 3), np.float32)  # in grid steps
        at[:, a], at[:, b], at[:, c] = i + v0 / (v0 - v1), j, k
        corners = []
        for dj, dk in ((-1, -1), (0, -1), (0, 0), (-1, 0)):  # the four cells around the edge
            cell = np.zeros((len(i), 3), np.int64)
            cell[:, a], cell[:, b], cell[:, c] = i, (j + dj).clip(0, n - 1), (k + dk).clip(0, n - 1)
            flat = np.ravel_multi_index(tuple(cell.T), (n, n, n))
            np.add.at(total.reshape(-1, 3), flat, at)
            np.add.at(count.reshape(-1), flat, 1)
            corners.append(flat)
        quad = np.stack(corners, 1)
        quads.append(np.where(s[:-1][i, j, k][:, None], quad, quad[:, ::-1]))
    quad = np.concatenate(quads)
    used, inverse = np.unique(quad, return_inverse=True)
    quad = inverse.reshape(quad.shape)
    vertices = axis[0] + h * total.reshape(-1, 3)[used] / count.reshape(-1)[used, None]
    return Mesh(vertices.astype(np.float64), np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]))
