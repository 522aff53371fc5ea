"""The path tracer: its frame and units, that it agrees with Mitsuba's own integrator, and what it renders for tests."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

import photonormal as pn
from photonormal.synth.pathtraced.variant import llvm, version
from photonormal.types import InputError

if importlib.util.find_spec("mitsuba") is None:
    pytest.skip("Mitsuba is not installed", allow_module_level=True)

from photonormal.synth.pathtraced import render_scene_set
from photonormal.synth.pathtraced.meshes import Triangles, polygonise, read_mesh
from photonormal.synth.pathtraced.objects import OBJECTS, sphere
from photonormal.synth.pathtraced.reflectance import bsdf, evaluate, fitted_parameters
from photonormal.synth.pathtraced.tracer import OrthographicCamera, build, eroded, look, reached, stock, trace
from photonormal.synth.pathtraced.variant import vectorised

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.5, 0.3]}}
OBLIQUE = np.array([[0.48, 0.36, 0.8], [-0.6, 0.0, 0.8], [0.0, -0.8, 0.6]])
fast = pytest.mark.skipif(llvm() is None, reason="no LLVM 17 or later: one ray at a time takes minutes")


def two_balls(material):
    small = {"type": "sphere", "center": [0.9, 0.3, 0.6], "radius": 0.4, "bsdf": material}
    return [{"type": "sphere", "bsdf": material}, small]


def test_a_matt_ball_is_its_albedo_times_the_cosine():
    camera = OrthographicCamera(x=0.1, y=-0.2, half=1.3, size=24)
    scene = build([{"type": "sphere", "bsdf": WHITE}], camera)
    seen = look(scene, camera)
    images = trace(scene, camera, OBLIQUE, 1, 0, centred=True) if vectorised() else None
    column, row = 15, 7  # right of and above the middle
    x, y = 0.1 + 1.3 * ((column + 0.5) / 12 - 1), -0.2 - 1.3 * ((row + 0.5) / 12 - 1)
    n = np.array([x, y, np.sqrt(1 - x * x - y * y)])
    assert np.allclose(seen.normals[row, column], n, atol=1e-5)
    if images is not None:
        value = np.clip(OBLIQUE @ n, 0, None)[:, None] * [0.8, 0.5, 0.3]
        assert np.allclose(images[:, row, column], value, atol=1e-4)


@pytest.mark.parametrize("bounces", [0, 2])
@fast
def test_many_lights_at_once_are_the_stock_integrators_images(bounces):
    camera = OrthographicCamera(half=1.4, size=32)
    scene = build(two_balls(WHITE), camera)
    ours = trace(scene, camera, OBLIQUE, 256, bounces)
    theirs = np.stack([stock(scene, l, 256, bounces) for l in OBLIQUE])
    assert np.allclose(ours.mean((1, 2)), theirs.mean((1, 2)), rtol=0.01)
    assert np.abs(ours - theirs).mean() / theirs.mean() < 0.03


@fast
def test_formulas_sample_the_directions_that_they_weigh():
    camera = OrthographicCamera(half=1.4, size=32)
    shiny = bsdf("principled", [0.9, 0.7, 0.4, 1, 0.35, 0.5, 0, 0, 0, 0, 0])
    scene = build(two_balls(shiny), camera)
    ours = trace(scene, camera, OBLIQUE, 256, 1)
    theirs = np.stack([stock(scene, l, 256, 1) for l in OBLIQUE])
    assert np.allclose(ours.mean((1, 2)), theirs.mean((1, 2)), rtol=0.02)


def test_a_ball_shades_its_neighbour():
    camera = OrthographicCamera(half=1.6, size=32)
    large, small = {"type": "sphere"}, {"type": "sphere", "center": [1.2, 0, 0.9], "radius": 0.25}
    l = np.array([[0.8, 0.0, 0.6]])
    row, column = 16, 24  # at (0.85, -0.05), near (0.8, 0, 0.6), where the small ball's shadow falls
    assert reached(build([large], camera), camera, l)[0, row, column]
    assert not reached(build([large, small], camera), camera, l)[0, row, column]


def test_formulas_agree_with_the_training_renderers():
    import torch

    from photonormal.synth.brdf.abc import ABC
    from photonormal.synth.brdf.principled import Principled
    from photonormal.synth.brdf.sgd import SGD

    g = np.random.default_rng(0)
    l, v = (np.abs(g.normal(size=(40, 3))) + np.array([0, 0, 0.3]) for _ in range(2))
    l, v = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (l, v))
    h = (l + v) / np.linalg.norm(l + v, axis=1, keepdims=True)
    cosines = l[:, 2], v[:, 2], h[:, 2], (l * h).sum(1)
    tensors = [torch.from_numpy(c.astype(np.float32)) for c in cosines]
    principled = np.array([0.7, 0.4, 0.2, 0.3, 0.4, 0.8, 0.5, 0.4, 0.6, 0.7, 0.3])
    abc = np.array([0.1, 0.2, 0.3, 5.0, 6.0, 7.0, 800.0, 1.2, 1.5])
    sgd = np.repeat([0.2, 0.05, 0.01, 1.1, 0.2, 0.05, 40.0, 0.3, -1.5, 1.2, 0.4], 3) * np.tile([1, 0.9, 1.1], 11)
    for family, values, model in (
        ("principled", principled, Principled(torch.tensor(principled, dtype=torch.float32)[:, None])),
        ("abc", abc, ABC(torch.tensor(abc, dtype=torch.float32)[:, None])),
        ("sgd", sgd, SGD(torch.tensor(sgd, dtype=torch.float32).view(11, 3, 1))),
    ):
        assert np.allclose(evaluate(family, values, *cosines), model(*tensors).numpy(), rtol=2e-3), family


def test_a_polygonised_ball_is_closed_and_faces_outwards():
    import trimesh

    mesh = polygonise(lambda p: np.linalg.norm(p - [0.1, 0, 0], axis=1) - 0.8, 1.2, 64)
    ball = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert ball.is_watertight and ball.volume == pytest.approx(4 / 3 * np.pi * 0.8**3, rel=0.01)
    assert np.abs(np.linalg.norm(mesh.vertices - [0.1, 0, 0], axis=1) - 0.8).max() < 2e-3


def test_objects_face_the_camera_and_are_one_unit_in_radius():
    for name in ("sphere", "bowl"):
        mesh = OBJECTS[name](None)
        extent = mesh.vertices.max(0) - mesh.vertices.min(0)
        assert extent[:2].max() == pytest.approx(2, abs=1e-3)


def test_a_mesh_inside_out_is_turned(tmp_path):
    ball = sphere()
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices[:42]]
    import trimesh

    small = trimesh.creation.icosphere(subdivisions=1)
    small.invert()
    small.export(tmp_path / "ball.obj")
    mesh = read_mesh(tmp_path / "ball.obj")
    assert trimesh.Trimesh(mesh.vertices, mesh.faces).volume > 0
    (tmp_path / "empty.obj").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"no faces|can't be read"):
        read_mesh(tmp_path / "empty.obj")


def test_llvm_is_known_by_its_files_name(tmp_path, monkeypatch):
    for name, number in {"libLLVM.so.19.1": 19, "libLLVM-16.so.1": 16, "libLLVM.so": 0}.items():
        (tmp_path / name).touch()
        assert version(tmp_path / name) == number
        monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / name))
        assert (llvm() is not None) == (number >= 17)


@fast
def test_clean_scenes_come_back_from_their_files(tmp_path):
    done = []
    out = render_scene_set(
        "clean", tmp_path / "clean", ["sphere"], 6, 32, samples=8, progress=lambda k, of: done.append((k, of))
    )
    capture = pn.load(out / "sphere")
    assert done == [(1, 1)] and capture.images.shape[0] == 6 and capture.truth is not None
    assert capture.images.shape[1:3] == capture.mask.shape
    lit = np.stack([capture.images[j].mean(-1) for j in range(6)])[:, capture.mask] > 1e-3
    normals = pn.solve(capture, "woodham")
    both = capture.mask & normals.mask & capture.truth.mask
    cos = (normals.map[both] * capture.truth.map[both]).sum(-1)
    always = np.all(lit, axis=0)[both[capture.mask]]
    assert np.degrees(np.arccos(np.clip(cos[always], -1, 1))).mean() < 1.0
    before = (out / "sphere" / "001.png").stat().st_mtime_ns
    assert render_scene_set("clean", out, ["sphere"], 6, 32, samples=8) == out
    assert (out / "sphere" / "001.png").stat().st_mtime_ns == before
    with pytest.raises(InputError, match="other arguments"):
        render_scene_set("clean", out, ["sphere"], 7, 32, samples=8)


@fast
def test_cycles_scenes_come_back_from_their_files(tmp_path):
    out = render_scene_set("cycles17", tmp_path / "c", ["sphere"], (4, 5), 32, samples=2)
    for kind in ("diffuse", "specular", "metallic"):
        capture = pn.load(out / "L5" / "sphere.obj" / f"images_{kind}")
        assert capture.images.shape[0] == 5 and capture.truth is not None
        n = capture.truth.map[capture.mask & capture.truth.mask]
        assert n[:, 2].min() > 0 and np.abs(n[:, :2].mean(0)).max() < 0.05
        assert capture.images[0][capture.mask].max() > 0.05
    assert not np.allclose(capture.images[0], pn.load(out / "L5" / "sphere.obj" / "images_diffuse").images[0])


@fast
def test_pleats_of_metal_come_back_from_their_files_and_have_its_colour(tmp_path):
    out = render_scene_set("hollows", tmp_path / "h", ["pouch", "folds"], 4, 32, samples=2)
    gold, aluminium = (pn.load(out / name) for name in ("pouch", "folds"))
    assert gold.truth is not None and (gold.truth.map[gold.mask & gold.truth.mask][:, 2] > 0).all()

    def red_over_blue(capture):
        red, _, blue = np.mean([capture.images[j][capture.mask].mean(0) for j in range(4)], 0)
        return red / blue

    assert red_over_blue(gold) > 1.8 and abs(red_over_blue(aluminium) - 1) < 0.1


@pytest.mark.parametrize("content", ["{", "[]", '{"settings": {}}', '{"settings": {}, "seconds": 3}'])
def test_a_damaged_list_of_what_is_rendered_is_refused(tmp_path, content):
    (tmp_path / "set.json").write_text(content)
    with pytest.raises(InputError, match=r"set\.json is damaged; remove"):
        render_scene_set("clean", tmp_path, 1, 4, 8)


@pytest.mark.data
@fast
def test_measured_scenes_come_back_from_their_files(tmp_path, data):
    assert len(fitted_parameters(data / "brdf", "abc")) == len(fitted_parameters(data / "brdf", "sgd")) == 100
    out = render_scene_set("statue100", tmp_path / "s", 2, 4, 32, data=data, samples=2)
    names = sorted(json.loads((out / "set.json").read_text())["seconds"])
    assert names == ["alum-bronze", "yellow-plastic"]
    capture = pn.load(out / "yellow-plastic")
    assert capture.images.shape[0] == 4 and capture.truth is not None
    I = np.stack([capture.images[j] for j in range(4)])[:, capture.mask]
    assert I[..., 0].mean() > 1.5 * I[..., 2].mean()  # yellow


def test_bad_arguments_are_named(tmp_path):
    with pytest.raises(InputError, match="no scene set 'cubes'; choose from spheres100"):
        render_scene_set("cubes", tmp_path)
    with pytest.raises(InputError, match="no object 'cube'; there are sphere"):
        render_scene_set("clean", tmp_path, ["cube"])
    with pytest.raises(InputError, match="at least 3"):
        render_scene_set("clean", tmp_path, lights=2)
    with pytest.raises(InputError, match="give the folder of meshes"):
        render_scene_set("clean", tmp_path, ["statue"], data=tmp_path)
    with pytest.raises(InputError, match=r"can't be read as a table"):
        render_scene_set("spheres100", tmp_path, data=Path("/nowhere"))


def test_erosion_takes_one_pixel_off():
    mask = np.zeros((7, 7), bool)
    mask[1:6, 1:6] = True
    assert eroded(mask).sum() == 9
    assert isinstance(Triangles(np.zeros((3, 3)), np.zeros((1, 3), int)).smooth_normals(), np.ndarray)
