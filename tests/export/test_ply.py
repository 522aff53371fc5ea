"""Meshes as PLY: written by parts, they are the whole mesh."""

import numpy as np
import pytest
import trimesh

import photonormal as pn
from photonormal.export import ply
from photonormal.export.mesh import faces, vertices
from photonormal.types import Normals, Surface


@pytest.mark.parametrize("at_a_time", [1, 30, 10**6])
def test_a_mesh_written_by_parts_is_the_whole_one(at_a_time, monkeypatch, tmp_path):
    monkeypatch.setattr(ply, "VERTICES", at_a_time)
    g = np.random.default_rng(0)
    mask = g.random((23, 17)) > 0.2
    mask[7] = False  # a band without any
    N = np.float32([0.6, 0, 0.8]) * g.choice([-1, 1], (23, 17, 3)).astype(np.float32)
    albedo = g.random((23, 17, 3)).astype(np.float32)
    surface = Surface(np.where(mask, g.random(mask.shape), np.nan).astype(np.float32), mask)
    mesh = trimesh.load(pn.save(surface, tmp_path / "m.ply", Normals(N, mask), albedo), process=False)
    np.testing.assert_allclose(mesh.vertices, vertices(surface), atol=1e-5)
    assert sorted(map(tuple, mesh.faces.tolist())) == sorted(map(tuple, faces(mask).tolist()))
    assert len(mesh.faces) == ply.face_count(mask)
    np.testing.assert_allclose(mesh.vertex_normals, N[mask], atol=1e-6)
    assert mesh.visual.vertex_colors.shape == (mask.sum(), 4) and (mesh.visual.vertex_colors[:, 3] == 255).all()


def test_one_pixel_is_a_mesh_of_one_point(tmp_path):
    surface = Surface(np.ones((1, 1), np.float32), np.ones((1, 1), bool))
    text = pn.save(surface, tmp_path / "m.ply").read_bytes()
    assert b"element vertex 1\n" in text and b"element face 0\n" in text
    assert np.frombuffer(text[-12:], "<f4").tolist() == [0.5, 0.5, 1.0]
