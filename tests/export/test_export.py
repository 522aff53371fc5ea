import io

import numpy as np
import pytest
import trimesh

import photonormal as pn
from photonormal.export import load_normals
from photonormal.export.mesh import display, faces, vertices
from photonormal.geometry import angle_deg
from photonormal.types import InputError, Surface
from tests.scenes import sphere


@pytest.mark.parametrize(("suffix", "tolerance_deg"), [(".png", 0.003), (".exr", 1e-5), (".npz", 1e-9)])
def test_export_then_load_is_the_identity(tmp_path, suffix, tolerance_deg):
    truth = sphere()
    back = load_normals(pn.save(truth, tmp_path / f"normals{suffix}"))
    assert (back.mask == truth.mask).all()
    assert angle_deg(back.map[back.mask], truth.map[truth.mask]).max() <= tolerance_deg


def test_expected_errors_are_kept_in_npz(tmp_path):
    truth = sphere()
    told = pn.Normals(truth.map, truth.mask, np.full(truth.mask.shape, 3.5))
    back = load_normals(pn.save(told, tmp_path / "normals.npz", frame="directx"), frame="directx")
    assert (back.expected_error_deg[truth.mask] == 3.5).all() and np.isnan(back.expected_error_deg[~truth.mask]).all()
    assert load_normals(pn.save(truth, tmp_path / "plain.npz")).expected_error_deg is None
    with pytest.raises(InputError, match="expected errors are"):
        pn.Normals(truth.map, truth.mask, np.zeros((2, 2)))


def test_png_is_16_bit_with_green_up(tmp_path):
    import cv2

    picture = cv2.imread(str(pn.save(sphere(size=49), tmp_path / "n.png")), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.uint16
    blue, green, red = picture[8, 24].astype(int)  # above the centre: looks up
    assert green > 40000 and abs(red - 32767) < 2 and blue > 32767
    assert picture[24, 40, 2] > 40000  # right of the centre: looks right


def plane(h: int = 6, w: int = 8, K=None) -> Surface:
    return Surface(np.full((h, w), 10.0), np.ones((h, w), bool), K)


def test_mesh_vertices_lie_on_the_pixels_centres():
    v = vertices(plane())
    assert v[0].tolist() == [0.5, 5.5, 10.0]  # upper left pixel: smallest x, largest y
    assert v[-1].tolist() == [7.5, 0.5, 10.0]


@pytest.mark.parametrize("K", [None, np.array([[50.0, 0, 20], [0, 50.0, 20], [0, 0, 1]])])
def test_a_mesh_of_few_faces_has_some_of_the_pixels_where_they_are(tmp_path, K):
    row, column = np.mgrid[:41, :43]
    surface = Surface(1.0 + 0.01 * row + 0.002 * column, np.ones((41, 43), bool), K)
    whole, few = (
        trimesh.load(pn.save(surface, tmp_path / f"{most}.ply", most_faces=most), process=False)
        for most in (10_000, 400)
    )
    assert len(whole.faces) == 2 * 40 * 42 and 200 < len(few.faces) <= 400
    places = {tuple(v) for v in np.asarray(whole.vertices).tolist()}
    assert all(tuple(v) in places for v in np.asarray(few.vertices).tolist())


def test_perspective_vertices_project_back_to_their_pixels():
    K = np.array([[50.0, 0, 4], [0, 60.0, 3], [0, 0, 1]])
    p = vertices(plane(K=K)) * [1, -1, -1]  # the camera's frame: y down, z into the scene
    u = p @ K.T
    assert np.allclose(u[:, :2] / u[:, 2:], np.argwhere(np.ones((6, 8)))[:, ::-1])
    assert np.allclose(p[:, 2], 10)


def test_triangles_face_the_camera_and_cover_the_mask():
    v, f = vertices(plane()), faces(np.ones((6, 8), bool))
    normal = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    assert (normal[:, 2] > 0).all()
    assert normal[:, 2].sum() / 2 == pytest.approx(5 * 7)


def test_a_missing_corner_leaves_one_triangle():
    mask = np.ones((2, 2), bool)
    for corner in np.ndindex(2, 2):
        hole = mask.copy()
        hole[corner] = False
        assert faces(hole).shape == (1, 3)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_meshes_open_elsewhere_with_what_was_written(tmp_path, suffix):
    truth = sphere()
    depth = np.where(truth.mask, 20 * truth.map[..., 2], np.nan)
    file = pn.save(Surface(depth, truth.mask), tmp_path / f"ball{suffix}", truth, np.ones((*truth.mask.shape, 3)))
    mesh = trimesh.load(io.BytesIO(file.read_bytes()), file_type=suffix[1:], force="mesh", process=False)
    assert len(mesh.vertices) == truth.mask.sum()
    assert np.isfinite(mesh.vertices).all()
    # the surface's own orientation agrees with the normals it was given
    assert np.median(angle_deg(np.asarray(mesh.vertex_normals), truth.map[truth.mask])) < 10


@pytest.mark.parametrize("channels", [1, 3])
def test_meshes_are_as_bright_as_the_albedo_of_one_channel_or_three(tmp_path, channels):
    albedo = np.full((6, 8, channels), 0.2140, np.float32)  # 127 in sRGB
    flat = pn.Normals(np.tile(np.float32([0, 0, 1]), (6, 8, 1)))
    ply, obj = (pn.save(plane(), tmp_path / f"plane{kind}", flat, albedo) for kind in (".ply", ".obj"))
    assert np.unique(trimesh.load(ply, process=False).visual.vertex_colors).tolist() == [127, 255]
    assert obj.read_text().startswith("v 0.5 5.5 10 0.498039 0.498039 0.498039\n")


def test_depth_npz_keeps_depth_mask_and_camera(tmp_path):
    K = np.diag([50.0, 50, 1])
    with np.load(pn.save(plane(K=K), tmp_path / "depth.npz")) as data:
        assert (data["K"] == K).all() and data["mask"].all() and (data["depth"] == 10).all()


def test_display_is_srgb():
    assert display(np.array([0.0, 0.2140, 1.0, 7.0, np.nan])).tolist() == [0, 127, 255, 255, 0]


def test_unknown_endings_and_files_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"'.jpg' but .png, .exr, .npz"):
        pn.save(sphere(), tmp_path / "n.jpg")
    with pytest.raises(InputError, match="does not exist"):
        load_normals(tmp_path / "n.png")
    (tmp_path / "n.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="is no PNG"):
        load_normals(tmp_path / "n.png")
    with pytest.raises(InputError, match="create it first"):
        pn.save(sphere(), tmp_path / "absent" / "n.png")


class Cloud:
    """Unpickling it would leave a file behind."""

    def __reduce__(self):
        return (open, ("hostile", "w"))


def test_a_hostile_npz_is_never_unpickled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.savez("n.npz", normals=np.array([Cloud()], dtype=object), mask=np.ones((2, 2), bool))
    with pytest.raises(InputError, match="can't be read"):
        load_normals("n.npz")
    assert not (tmp_path / "hostile").exists()
