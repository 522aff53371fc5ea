"""Meshes from files as shapes of scenes: any view of them, by a z-buffer."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from photonormal.files.opening import reason_of
from photonormal.synth.params import rotations, tensor
from photonormal.types import InputError

SUFFIXES = (".obj", ".ply", ".stl", ".off", ".glb")
STATUE = "nefertiti/nefertiti-lowres.obj"  # of the test scenes: no recipe shows what has its name
CANDIDATES = 2**24  # pixels of triangles' boxes that are tested at a time


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh, centred and scaled into the unit sphere."""

    vertices: Float[Tensor, "v 3"]
    normals: Float[Tensor, "v 3"]  # unit, smooth
    faces: Int[Tensor, "f 3"]


@dataclass(frozen=True)
class MeshViews:
    """`b` views of meshes, in place of drawn solids."""

    meshes: tuple[Mesh, ...]
    which: Int[Tensor, " b"]
    R: Float[Tensor, "b 3 3"]  # mesh frame -> world

    def surface(
        self, centre: Float[Tensor, "b 2"], half: Float[Tensor, " b"], size: int
    ) -> tuple[Float[Tensor, "b 6 s s"], Float[Tensor, "b 3 s s"]]:
        """Depth (-inf: none), unit normal (0) and depths behind (-inf), and the points in the mesh's own frame."""
        maps, points = [], []
        for k, R, c, h in zip(self.which.tolist(), self.R, centre, half, strict=True):
            mesh = self.meshes[k]
            v = mesh.vertices.to(R.device) @ R.T
            xy = (v[:, :2] - c) / h * v.new_tensor([size / 2, -size / 2]) + size / 2  # column, row
            z, face, w, behind = rasterise(xy, v[:, 2], mesh.faces.to(R.device), size)
            corners = mesh.faces.to(R.device)[face.clamp(min=0)]  # (s, s, 3)

            def mixed(values: Tensor, w: Tensor = w, corners: Tensor = corners, face: Tensor = face) -> Tensor:
                return ((values[corners] * w[..., None]).sum(-2) * (face >= 0)[..., None]).movedim(-1, 0)

            n = mixed(mesh.normals.to(R.device) @ R.T)
            maps.append(torch.cat([z[None], n / n.norm(dim=0).clamp(min=1e-9), behind]))
            points.append(mixed(mesh.vertices.to(R.device)))
        return torch.stack(maps), torch.stack(points)


def rasterise(
    xy: Float[Tensor, "v 2"], z: Float[Tensor, " v"], faces: Int[Tensor, "f 3"], size: int
) -> tuple[Float[Tensor, "s s"], Int[Tensor, "s s"], Float[Tensor, "s s 3"], Float[Tensor, "2 s s"]]:
    """Highest face at the centre of each pixel: its depth (-inf: none), index (-1) and barycentric weights.

    Then the depths behind: of the highest face below that is seen from inside, and of the next seen from outside.
    """
    device = xy.device
    p = xy[faces]  # (f, 3, 2): column, row
    depth = torch.full((size * size,), -torch.inf, device=device)
    index = torch.full((size * size,), -1, dtype=torch.long, device=device)
    low = (p.amin(1) - 0.5).ceil().clamp(min=0).long()  # first and last pixel centres inside a face's box
    high = (p.amax(1) - 0.5).floor().clamp(max=size - 1).long()
    extent = (high - low + 1).amin(1).clamp(min=0), (high - low + 1).amax(1)
    area = _cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])  # negative when seen from outside: rows grow downwards
    front = area.abs() > 1e-9
    kept = []
    width = 1
    while width < 2 * size:
        chosen = ((extent[0] > 0) & front & (extent[1] <= width) & (extent[1] > width // 2)).nonzero()[:, 0]
        for some in chosen.split(max(1, CANDIDATES // width**2)):
            kept.append(_covered(p[some], z[faces[some]], low[some], high[some], width, size, some))
        width *= 2
    for pixel, d, _ in kept:
        depth.scatter_reduce_(0, pixel, d, "amax")
    for pixel, d, face in kept:
        top = d == depth[pixel]
        index[pixel[top]] = face[top]
    behind = [depth]
    for outside in (False, True):
        below = torch.full_like(depth, -torch.inf)
        for pixel, d, face in kept:
            now = ((area[face] < 0) == outside) & (d < behind[-1][pixel])
            below.scatter_reduce_(0, pixel[now], d[now], "amax")
        behind.append(below)
    t = torch.arange(size, device=device) + 0.5
    centre = torch.stack([t.expand(size, size), t[:, None].expand(size, size)], -1)
    w = _weights(p[index.view(size, size).clamp(min=0)], centre)
    return depth.view(size, size), index.view(size, size), w, torch.stack(behind[1:]).view(2, size, size)


def _covered(p: Tensor, z: Tensor, low: Tensor, high: Tensor, width: int, size: int, faces: Tensor):
    """Pixels whose centres lie in faces, the depths there, and the faces."""
    k = torch.arange(width, device=p.device)
    column, row = low[:, 0, None, None] + k, low[:, 1, None, None] + k[:, None]  # (f, 1, w), (f, w, 1)
    column, row = torch.broadcast_tensors(column, row)
    w = _weights(p[:, None, None], torch.stack([column, row], -1) + 0.5)  # (f, w, w, 3)
    inside = (w >= -1e-6).all(-1) & (column <= high[:, 0, None, None]) & (row <= high[:, 1, None, None])
    f, i, j = inside.nonzero().unbind(1)
    d = (w[f, i, j] * z[f]).sum(-1)
    return row[f, i, j] * size + column[f, i, j], d, faces[f]


def _weights(p: Tensor, x: Tensor) -> Tensor:
    """Barycentric weights (..., 3) of points x (..., 2) in triangles p (..., 3, 2)."""
    a, b, c = p.unbind(-2)
    area = _cross(b - a, c - a)
    area = torch.where(area.abs() < 1e-9, 1e-9, area)
    u, v = _cross(b - x, c - x) / area, _cross(c - x, a - x) / area
    return torch.stack([u, v, 1 - u - v], -1)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def load_mesh(path: Path | str) -> Mesh:
    """A mesh from a file.

    Raises
    ------
    InputError
        If the file can't be read, has no faces, holds NaN, or is inside out.
    """
    import trimesh

    try:
        with warnings.catch_warnings(action="ignore"):
            mesh = trimesh.load(str(path), force="mesh", process=False)
        vertices = np.asarray(mesh.vertices, np.float64)  # pyright: ignore[reportAttributeAccessIssue]
        faces = np.asarray(mesh.faces, np.int64)  # pyright: ignore[reportAttributeAccessIssue]
    except Exception as error:  # trimesh's readers raise anything
        raise InputError(f"{path} can't be read as a mesh ({reason_of(error)}); give an OBJ or PLY file.") from None
    if faces.size == 0:
        raise InputError(f"{path} has {len(vertices)} vertices and no faces; give a mesh of triangles.")
    if not np.isfinite(vertices).all():
        raise InputError(f"{path} has vertices that are not finite; repair the mesh.")
    _, inverse = np.unique(vertices.round(9), axis=0, return_inverse=True)  # seams of a texture aren't edges
    corners = vertices[faces]  # (f, 3, 3)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])  # (f, 3) twice the area vectors
    if np.einsum("fi,fi->", corners.mean(1) - np.median(vertices, 0), area) < 0:
        raise InputError(f"{path} is inside out (its volume is negative); reverse the order of its faces' corners.")
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, inverse.ravel()[faces[:, corner]], area)
    normals = normals[inverse.ravel()]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-12)
    centre = (vertices.max(0) + vertices.min(0)) / 2
    scale = np.linalg.norm(vertices - centre, axis=1).max()
    return Mesh(tensor((vertices - centre) / scale), tensor(normals), torch.from_numpy(faces))


@lru_cache(maxsize=4)
def load_meshes(folder: str) -> tuple[Mesh, ...]:
    """All meshes in a folder and its subfolders, by name, but the statue that is kept for tests."""
    kept_out = Path(STATUE).parts[0]
    paths = sorted(p.relative_to(folder) for p in Path(folder).rglob("*") if p.suffix.lower() in SUFFIXES)
    paths = [path for path in paths if kept_out not in str(path).lower()]
    if not paths:
        raise InputError(
            f"{folder} holds no {', '.join(SUFFIXES)} but the test scenes' {kept_out}; give a folder of meshes."
        )
    return tuple(load_mesh(Path(folder) / path) for path in paths)


def mesh_folder(meshes: str | None) -> str | None:
    """The folder that a recipe's `meshes` names; "data" is PHOTONORMAL_DATA/meshes, or none where that is not there."""
    if meshes != "data":
        return meshes
    folder = Path(os.environ.get("PHOTONORMAL_DATA", "")) / "meshes"
    return str(folder) if "PHOTONORMAL_DATA" in os.environ and folder.is_dir() else None


def draw_views(g: np.random.Generator, b: int, folder: str) -> MeshViews:
    """`b` meshes of a folder from any side."""
    meshes = load_meshes(folder)
    return MeshViews(meshes, torch.from_numpy(g.integers(0, len(meshes), b)), tensor(rotations(g, (b,))))
