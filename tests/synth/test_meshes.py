"""Meshes as shapes: depth and normals by a z-buffer, and files that can't be used."""

import numpy as np
import pytest
import torch
import trimesh

from photonormal.synth import Stream
from photonormal.synth.meshes import STATUE, MeshViews, load_mesh, load_meshes
from photonormal.synth.trace import NOWHERE, WindowView, visible_surface
from photonormal.types import InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes")
    trimesh.creation.icosphere(4).export(path / "ball.obj")
    trimesh.creation.torus(1.0, 0.35).export(path / "ring.obj")
    return path


def test_a_fine_sphere_has_a_spheres_normals(folder):
    views = MeshViews((load_mesh(folder / "ball.obj"),), torch.zeros(1, dtype=torch.long), torch.eye(3)[None])
    view = WindowView(torch.zeros(1, 2), torch.tensor([1.1]), 96)
    g = visible_surface(views, view, torch.zeros(1, 1))
    x, y = (v.view(96, 96) for v in view.rays(96))
    n = torch.stack([x, y, (1 - x**2 - y**2).clamp(min=0).sqrt()])
    inner = x**2 + y**2 < 0.9
    assert g.mask[0][inner].all() and not g.mask[0][x**2 + y**2 > 1].any()
    error = torch.rad2deg(torch.linalg.cross(g.normals[0], n, dim=0).norm(dim=0))[inner]
    assert error.mean() < 0.5 and error.max() < 3
    assert ((g.height[0] * view.pixel - n[2]).abs()[inner] < 0.01).all()
    assert ((g.behind[0, 0] + g.height[0]).abs()[inner] < 0.5).all()  # as far behind the middle, in pixels
    assert (g.behind[0, 1] == NOWHERE).all()


def test_a_turned_mesh_is_seen_turned(folder):
    mesh = load_mesh(folder / "ring.obj")
    up = torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # about x by a quarter: the ring is seen from its edge
    view = WindowView(torch.zeros(2, 2), torch.full((2,), 1.1), 64)
    g = visible_surface(MeshViews((mesh,), torch.zeros(2, dtype=torch.long), torch.stack([torch.eye(3), up])), view,
                        torch.zeros(2, 1))  # fmt: skip
    assert not g.mask[0, 32, 32] and g.mask[1, 32, 32]  # the hole
    assert g.mask[1].any(1).sum() < 0.5 * g.mask[0].any(1).sum()
    tube = 0.35 / 1.35 / view.pixel[0]  # its radius in pixels, seen through the hole from its edge
    z = torch.cat([g.height[1:], g.behind[1]])[:, 32, 32]
    assert torch.allclose(z, torch.tensor([1.35, 0.65, -0.65]) / 0.35 * tube, atol=0.7)


def test_a_stream_of_meshes(folder, monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)
    batch = next(iter(Stream("train", 4, meshes=str(folder), size=64, crops=2, scenes=2, lights=(4, 4))))
    assert batch.images.shape == (4, 4, 3, 32, 32) and batch.images.isfinite().all()
    assert (batch.mask.float().mean((1, 2, 3)) >= 0.5).all()


def test_the_statue_of_the_test_scenes_is_never_shown(folder, tmp_path):
    ball = (folder / "ball.obj").read_bytes()
    for name in ("spot/spot.obj", STATUE, "own/Nefertiti.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(ball)
    assert len(load_meshes(str(tmp_path))) == 1
    with pytest.raises(InputError, match="but the test scenes' nefertiti"):
        load_meshes(str(tmp_path / "own"))


def write_obj(path, vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")


def test_unusable_meshes_are_refused_in_one_line(tmp_path):
    box = trimesh.creation.box()
    cases = {
        "nothing": (box.vertices, np.zeros((0, 3), int), "no faces"),
        "nan": (np.where(np.arange(24).reshape(8, 3) == 4, np.nan, box.vertices), box.faces, "not finite"),
        "inside": (box.vertices, box.faces[:, ::-1], "inside out"),
    }
    for name, (vertices, faces, message) in cases.items():
        write_obj(tmp_path / f"{name}.obj", vertices, faces)
        with pytest.raises(InputError, match=message) as caught:
            load_mesh(tmp_path / f"{name}.obj")
        assert "\n" not in str(caught.value)
    (tmp_path / "noise.obj").write_bytes(bytes(range(256)))
    with pytest.raises(InputError):
        load_mesh(tmp_path / "noise.obj")
    with pytest.raises(InputError, match="can't be read as a mesh"):
        load_mesh(tmp_path / "absent.obj")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"holds no \.obj"):
        load_meshes(str(tmp_path / "empty"))
