"""Heights as pictures and depth in millimetres say the same surface; meshes hold colours and places in the picture."""

import io

import cv2
import numpy as np
import pytest
import trimesh

import photonormal as pn
from photonormal.cli import main
from photonormal.export.heights import read_depth
from photonormal.export.mesh import display
from photonormal.export.pictures import read_albedo, read_colours
from photonormal.files.decode import decode
from photonormal.files.remarks import is_srgb, remark
from photonormal.types import Surface
from tests.capture.files import refusal, write_picture
from tests.scenes import sphere

BALL = sphere()
DEPTH = np.where(BALL.mask, 20 * BALL.map[..., 2], np.nan)
K = np.array([[100.0, 0, 24], [0, 100, 24], [0, 0, 1]])


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_16_bits_from_the_lowest_to_the_highest(tmp_path, suffix):
    path = pn.save(Surface(DEPTH, BALL.mask), tmp_path / f"h{suffix}", mm_per_px=0.5)
    level = decode(path)[..., 0]
    assert level.dtype == np.uint16 and level.min() == 0 and level.max() == 65535 and (level[~BALL.mask] == 0).all()
    low, high = 0.5 * np.nanmin(DEPTH), 0.5 * np.nanmax(DEPTH)
    assert np.abs(low + (high - low) * level / 65535 - 0.5 * DEPTH)[BALL.mask].max() < (high - low) / 65535
    if suffix == ".png":
        said = (remark(path, "photonormal-height") or "").split()
        assert said[0] == "from" and np.allclose([float(said[1]), float(said[3])], [low, high]) and said[4] == "mm"


def test_floats_are_the_heights_themselves(tmp_path):
    z = decode(pn.save(Surface(DEPTH, BALL.mask), tmp_path / "h.exr"))[..., 0]
    np.testing.assert_allclose(z[BALL.mask], DEPTH[BALL.mask], rtol=1e-6)
    assert (z[~BALL.mask] == z[BALL.mask].min()).all()


def test_what_is_nearer_is_higher_in_perspective_too(tmp_path):
    distance = np.where(BALL.mask, 1.2 - 0.2 * BALL.map[..., 2], np.nan)
    z = decode(pn.save(Surface(distance, BALL.mask, K), tmp_path / "h.exr", mm_per_px=0.5))[..., 0]
    np.testing.assert_allclose(z[BALL.mask], 50 * (1 - distance[BALL.mask]), atol=1e-4)  # 100 px of 0.5 mm away


@pytest.mark.parametrize("camera", [None, K])
def test_depth_in_millimetres_comes_back_in_pixels(tmp_path, camera):
    path = pn.save(Surface(DEPTH, BALL.mask, camera), tmp_path / "d.npz", mm_per_px=0.25)
    unit = 0.25 if camera is None else 25
    np.testing.assert_allclose(np.load(path)["depth"], unit * DEPTH, rtol=1e-6)
    np.testing.assert_allclose(read_depth(path).depth, DEPTH, rtol=1e-6)


@pytest.mark.parametrize("suffix", [".obj", ".glb"])
def test_meshes_hold_colours_and_places(tmp_path, suffix):
    albedo = np.random.default_rng(0).random((*BALL.mask.shape, 3)).astype(np.float32)
    path = pn.save(Surface(DEPTH, BALL.mask), tmp_path / f"m{suffix}", BALL, albedo, mm_per_px=0.5)
    scene = trimesh.load_scene(io.BytesIO(path.read_bytes()), file_type=suffix[1:], process=False)
    (mesh,) = scene.geometry.values()
    assert len(mesh.vertices) == BALL.mask.sum() and np.ptp(mesh.vertices[:, 0]) < 0.5 * BALL.mask.shape[1]
    row, column = np.nonzero(BALL.mask)
    uv = np.stack([(column + 0.5) / BALL.mask.shape[1], 1 - (row + 0.5) / BALL.mask.shape[0]], axis=-1)
    np.testing.assert_allclose(mesh.visual.uv, uv, atol=1e-5)
    if suffix == ".glb":  # glTF's colours are linear
        stored = mesh.visual.vertex_attributes["color"][:, :3]
        np.testing.assert_allclose(stored, np.rint(255 * albedo[BALL.mask]), atol=1)
    else:
        rows = [line.split()[4:] for line in path.read_text().splitlines() if line.startswith("v ")]
        np.testing.assert_allclose(np.array(rows, float) * 255, display(albedo)[BALL.mask], atol=1e-2)


def test_albedo_is_srgb_and_says_so_unless_it_is_to_be_linear(tmp_path):
    for flag, tagged in (([], True), (["--linear-albedo"], False)):
        out = tmp_path / f"r{tagged}"
        assert main(["measure", "demo", "--method", "woodham", "--no-mesh", "--out", str(out), *flag]) == 0
        assert is_srgb(out / "albedo.png") == tagged
    encoded, linear = (read_albedo(tmp_path / name / "albedo.png") for name in ("rTrue", "rFalse"))
    np.testing.assert_allclose(encoded, linear, atol=1e-4)
    assert decode(tmp_path / "rTrue" / "albedo.png").mean() > 1.2 * decode(tmp_path / "rFalse" / "albedo.png").mean()


def test_a_texture_colours_a_mesh(tmp_path):
    texture = np.full((*BALL.mask.shape, 3), [200, 100, 50], np.uint8)
    write_picture(tmp_path / "wood.png", texture)
    pn.save(BALL, tmp_path / "n.png")
    command = ["integrate", str(tmp_path / "n.png"), "--albedo", str(tmp_path / "wood.png"), "--out"]
    assert main([*command, str(tmp_path / "m.obj")]) == 0
    line = next(x for x in (tmp_path / "m.obj").read_text().splitlines() if x.startswith("v "))
    np.testing.assert_allclose(np.array(line.split()[4:], float) * 255, [200, 100, 50], atol=0.01)
    write_picture(tmp_path / "small.png", texture[:9])
    assert "are needed" in refusal(read_colours, tmp_path / "small.png", BALL.mask.shape)


def test_a_tile_has_no_seams(tmp_path):
    from tests.export.test_foreign import encoded, waves

    truth, height = waves(steep=0.5)
    write_picture(tmp_path / "n.png", encoded(truth.map, np.uint16))
    shifted = np.roll(truth.map, (31, 40), (0, 1))
    write_picture(tmp_path / "shifted.png", encoded(shifted, np.uint16))
    found = {}
    for name in ("n", "shifted"):
        out = tmp_path / f"{name}.exr"
        assert main(["integrate", str(tmp_path / f"{name}.png"), "--tile", "--out", str(out)]) == 0
        found[name] = decode(out)[..., 0]
    assert np.abs(found["n"] - height).max() < 0.03
    assert np.abs(np.roll(found["shifted"], (-31, -40), (0, 1)) - found["n"]).max() < 0.01
    assert cv2.imread(str(tmp_path / "n.png"), cv2.IMREAD_UNCHANGED) is not None  # what is read is left alone


def test_a_tile_with_a_hole_and_without_perspective():
    from tests.export.test_foreign import waves

    truth, height = waves(steep=0.5)
    mask = truth.mask.copy()
    mask[20:30, :12] = False
    off = (pn.integrate(pn.Normals(truth.map, mask), "periodic").depth - height)[mask]
    assert np.abs(off - off.mean()).max() < 0.05
    assert "no perspective" in refusal(pn.integrate, truth, "periodic", K=K)
