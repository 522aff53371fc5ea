"""Normal maps from elsewhere say the same surface, however their numbers are written, or are refused in one line."""

import numpy as np
import pytest

import photonormal as pn
from photonormal.cli import main
from photonormal.export import load_normals, save
from photonormal.geometry import angle_deg, in_frame
from photonormal.types import InputError, Normals
from tests.capture.files import refusal, write_picture
from tests.files.test_tga import write_tga

N = 96


def waves(size: int = N, steep: float = 1.0) -> tuple[Normals, np.ndarray]:
    """A surface that repeats, its normals and its heights in pixels; nothing of it looks the same mirrored."""
    y, x = np.mgrid[:size, :size] * 2 * np.pi / size
    terms = ((3.0, 1, 2, 0.3), (2.0, 3, -1, 1.0), (1.5, -2, 2, 2.0), (2.5, 1, 0, 0.7), (1.0, 2, 3, 0.1))
    z = steep * sum(A * np.sin(a * x + b * y + p) for A, a, b, p in terms)
    dx = steep * sum(A * a * np.cos(a * x + b * y + p) for A, a, b, p in terms) * 2 * np.pi / size
    dy = steep * sum(A * b * np.cos(a * x + b * y + p) for A, a, b, p in terms) * 2 * np.pi / size  # downwards
    n = np.stack([-dx, dy, np.ones_like(z)], axis=-1)
    return Normals(n / np.linalg.norm(n, axis=-1, keepdims=True), np.ones(z.shape, bool)), z - z.mean()


TRUTH, HEIGHT = waves()
OBJECT = np.hypot(*(np.mgrid[:N, :N] - N / 2)) < 40


def encoded(map: np.ndarray, dtype: type = np.uint8) -> np.ndarray:
    return np.rint((map + 1) / 2 * np.iinfo(dtype).max).astype(dtype)


def read(path, **how) -> tuple[Normals, str]:
    told: list[str] = []
    return load_normals(path, tell=told.append, **how), " ".join(told)


def error_deg(found: Normals, truth: Normals = TRUTH) -> float:
    return float(angle_deg(found.map, truth.map)[found.mask & truth.mask].max())


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".tga", ".bmp", ".npy"])
def test_any_kind_of_picture(tmp_path, suffix):
    picture = encoded(TRUTH.map)
    path = tmp_path / f"n{suffix}"
    write_tga(path, picture, runs=True) if suffix == ".tga" else write_picture(path, picture)
    found, said = read(path)
    assert found.mask.all() and "100.0 %" in said
    assert np.median(angle_deg(found.map, TRUTH.map)) < (2 if suffix == ".jpg" else 0.5)


@pytest.mark.parametrize("background", [0, 255, 127, 128], ids=["black", "white", "grey 127", "grey 128"])
def test_background_has_no_normal(tmp_path, background):
    picture = encoded(TRUTH.map)
    picture[~OBJECT] = background
    found, said = read(write_picture(tmp_path / "n.png", picture))
    assert (found.mask == OBJECT).all() and error_deg(found) < 0.7 and "100.0 % of the pixels that are not back" in said


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_is_transparent_is_background_whatever_its_colour(tmp_path, dtype):
    picture = np.concatenate([encoded(TRUTH.map, dtype), np.zeros((N, N, 1), dtype)], axis=-1)
    picture[~OBJECT, :3] = encoded(np.array([0, 0, 1.0]), dtype)
    picture[OBJECT, 3] = np.iinfo(dtype).max
    assert (read(write_picture(tmp_path / "n.png", picture))[0].mask == OBJECT).all()


def test_alpha_that_holds_gloss_cuts_nothing_out(tmp_path):
    gloss = np.random.default_rng(0).integers(20, 200, (N, N, 1)).astype(np.uint8)
    for alpha in (gloss, 0 * gloss):
        picture = np.concatenate([encoded(TRUTH.map), alpha], axis=-1)
        assert read(write_picture(tmp_path / "n.png", picture))[0].mask.all()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_vectors_of_other_lengths_keep_their_directions(tmp_path, dtype):
    length = np.random.default_rng(1).uniform(0.5, 1, (N, N, 1))
    found, _ = read(write_picture(tmp_path / "n.png", encoded(length * TRUTH.map, dtype)))
    assert found.mask.all() and error_deg(found) < (1.2 if dtype == np.uint8 else 0.01)


def test_a_resized_map_keeps_every_pixel(tmp_path):
    import cv2

    big = encoded(np.tile(waves(24)[0].map, (16, 16, 1)))
    small = cv2.resize(big, (N, N), interpolation=cv2.INTER_AREA)
    assert np.quantile(np.linalg.norm(small / 127.5 - 1, axis=-1), 0.05) < 0.9
    assert read(write_picture(tmp_path / "n.png", small))[0].mask.all()


@pytest.mark.parametrize("blue", [0, 255, 128])
def test_two_channels(tmp_path, blue):
    picture = encoded(TRUTH.map)
    picture[..., 2] = blue
    path = write_picture(tmp_path / "n.png", picture)
    said = refusal(load_normals, path)
    assert "blue is the same everywhere" in said and "--channels xy" in said
    assert error_deg(read(path, channels="xy")[0]) < 0.7


def test_blue_that_holds_something_else_is_refused(tmp_path):
    picture = encoded(waves(steep=2)[0].map)
    y, x = np.mgrid[:N, :N]
    picture[..., 2] = (100 + 100 * np.sin(x / 3.0) * np.cos(y / 5.0)).astype(np.uint8)
    path = write_picture(tmp_path / "n.png", picture)
    assert "--channels xy" in refusal(load_normals, path)
    assert error_deg(read(path, channels="xy")[0], waves(steep=2)[0]) < 0.8


def test_x_in_alpha(tmp_path):
    picture = encoded(TRUTH.map)
    stored = np.stack([0 * picture[..., 0] + 255, picture[..., 1], picture[..., 1], picture[..., 0]], axis=-1)
    assert error_deg(read(write_picture(tmp_path / "n.png", stored), channels="wy")[0]) < 0.7


def test_z_from_zero_is_told_by_the_lengths(tmp_path):
    truth = waves(steep=2)[0]
    picture = encoded(truth.map)
    picture[..., 2] = np.rint(255 * truth.map[..., 2])
    found, said = read(write_picture(tmp_path / "n.png", picture))
    assert error_deg(found, truth) < 0.7 and "z from 0" in said


@pytest.mark.parametrize("suffix", [".exr", ".npy", ".tif"])
@pytest.mark.parametrize("half", [False, True], ids=["vectors", "(n + 1) / 2"])
def test_floats_hold_vectors_or_halves_of_them(tmp_path, suffix, half):
    map = (TRUTH.map + 1) / 2 if half else TRUTH.map
    found, _ = read(write_picture(tmp_path / f"n{suffix}", map.astype(np.float32)))
    assert found.mask.all() and error_deg(found) < 0.01


@pytest.mark.parametrize("codes", [False, True])
def test_matlab(tmp_path, codes):
    from scipy.io import savemat

    stored = encoded(TRUTH.map) if codes else TRUTH.map.astype(float)
    savemat(tmp_path / "n.mat", {"surface": stored, "mask": OBJECT, "z": HEIGHT}, do_compression=True)
    found, _ = read(tmp_path / "n.mat")
    assert found.mask.all() and error_deg(found) < (0.7 if codes else 1e-3)
    savemat(tmp_path / "two.mat", {"a": stored, "b": stored})
    assert "holds 2 arrays" in refusal(load_normals, tmp_path / "two.mat")
    savemat(tmp_path / "named.mat", {"a": 0 * stored, "normals": stored})
    assert error_deg(read(tmp_path / "named.mat")[0]) < 0.7


def test_what_is_no_number_is_background(tmp_path):
    map = np.where(OBJECT[..., None], TRUTH.map, np.nan)
    assert (read(write_picture(tmp_path / "n.npy", map))[0].mask == OBJECT).all()


class TestFrames:
    @pytest.mark.parametrize("frame", ["directx", "y-down", "z-away"])
    def test_curl_and_z_tell(self, tmp_path, frame):
        found, said = read(write_picture(tmp_path / "n.png", encoded(in_frame(TRUTH.map, frame))))
        assert error_deg(found) < 0.7 and f"--frame {frame}" in said

    def test_ours_is_left_alone(self, tmp_path):
        assert "--frame" not in read(write_picture(tmp_path / "n.png", encoded(TRUTH.map)))[1]

    def test_a_flat_map_tells_nothing(self, tmp_path):
        flat = np.tile(np.uint8([128, 128, 255]), (N, N, 1))
        found, said = read(write_picture(tmp_path / "n.png", flat))
        assert (found.map == [0, 0, 1]).all() and "--frame" not in said
        away = write_picture(tmp_path / "away.png", np.tile(np.uint8([128, 128, 0]), (N, N, 1)))
        assert "look away from the camera" in refusal(load_normals, away)

    def test_what_the_user_says_counts(self, tmp_path):
        path = write_picture(tmp_path / "n.png", encoded(in_frame(TRUTH.map, "directx")))
        assert error_deg(read(path, frame="opengl")[0]) > 10 and error_deg(read(path, frame="directx")[0]) < 0.7

    def test_the_world_of_blender(self, tmp_path):
        """From the front, x is right there, y away from the camera and z up."""
        path = write_picture(tmp_path / "n.exr", np.tile(np.float32([0, -1, 0]), (N, N, 1)))
        assert (read(path, frame="blender")[0].map == [0, 0, 1]).all()
        assert "--frame blender" in refusal(load_normals, path)
        path = write_picture(tmp_path / "n.png", encoded(in_frame(TRUTH.map, "blender")))
        assert error_deg(read(path, frame="blender")[0]) < 0.7

    @pytest.mark.parametrize("suffix", [".png", ".exr", ".npz"])
    @pytest.mark.parametrize("frame", ["opengl", "directx", "blender"])
    def test_files_tell_theirs(self, tmp_path, suffix, frame):
        path = save(TRUTH, tmp_path / f"n{suffix}", frame=frame)
        found, said = read(path)
        assert error_deg(found) < 0.01 and "green" not in said
        other = "y-down" if suffix == ".npz" else "directx"
        if frame not in ("opengl", other):
            assert "nevertheless" in read(path, frame=other, partial=True)[1]


class TestZero:
    """Half a code, 0.4 % of full scale, is a slope of one pixel over 256."""

    @pytest.mark.parametrize(("scale", "zero"), [(127.5, 127.5), (127, 128), (127.5, 127)])
    def test_is_where_it_was_put(self, tmp_path, scale, zero):
        truth, _ = waves(256, steep=4)
        codes = np.rint(truth.map * scale + zero).clip(0, 255).astype(np.uint8)
        found, _ = read(write_picture(tmp_path / "n.png", codes))
        off = (found.map - truth.map).mean((0, 1))
        assert np.abs(off[:2]).max() < 4e-4  # a tenth of half a code

    @pytest.mark.parametrize("code", [127, 128])
    @pytest.mark.parametrize("flat", [1.0, 0.5])
    def test_flat_stays_flat(self, tmp_path, code, flat):
        picture = np.tile(np.uint8([code, code, 255]), (N, N, 1))
        picture[int(flat * N) :] = encoded(TRUTH.map[int(flat * N) :])
        found, _ = read(write_picture(tmp_path / "n.png", picture))
        assert (found.map[: int(flat * N)] == [0, 0, 1]).all()


class TestRefused:
    def test_a_height_map(self, tmp_path):
        level = np.rint(127 + 100 * HEIGHT / np.abs(HEIGHT).max()).astype(np.uint8)
        for picture in (level[..., None], np.repeat(level[..., None], 3, axis=-1)):
            assert "no normal map" in refusal(load_normals, write_picture(tmp_path / "h.png", picture))

    def test_a_photograph(self, tmp_path):
        y, x = np.mgrid[:N, :N]
        photograph = np.stack([100 + x, 40 + y + x // 3, 160 - x // 2], axis=-1).astype(np.uint8)
        said = refusal(load_normals, write_picture(tmp_path / "p.png", photograph))
        assert "no normal map" in said

    def test_unless_it_is_asked_for(self, tmp_path):
        picture = encoded(TRUTH.map)
        picture[: N // 4] = [250, 20, 90]  # nothing that a normal map holds
        path = write_picture(tmp_path / "n.png", picture)
        assert "75 % of the pixels" in refusal(load_normals, path)
        found, said = read(path, partial=True)
        assert "75.0 %" in said and not found.mask[: N // 4].any() and found.mask[N // 4 :].all()

    def test_what_is_refused_says_nothing_else(self, tmp_path):
        picture = encoded(TRUTH.map)
        picture[..., 2] = np.rint(255 * TRUTH.map[..., 2])  # z from 0, of which a note would tell
        picture[: N // 4] = [250, 20, 90]
        path, told = write_picture(tmp_path / "n.png", picture), []
        assert "of the pixels" in refusal(load_normals, path, tell=told.append) and not told
        load_normals(path, tell=told.append, partial=True)
        assert "z from 0 to 1" in " ".join(told)

    def test_background_alone(self, tmp_path):
        assert "nothing but background" in refusal(
            load_normals, write_picture(tmp_path / "n.png", np.zeros((9, 9, 3), np.uint8))
        )

    def test_unknown_channels(self, tmp_path):
        path = write_picture(tmp_path / "n.png", encoded(TRUTH.map))
        assert "choose from auto, xyz, xy, wy" in refusal(load_normals, path, channels="zyx")
        assert "has 3 channels" in refusal(load_normals, path, channels="wy")

    def test_a_mask_of_another_size(self, tmp_path):
        path = write_picture(tmp_path / "n.png", encoded(TRUTH.map))
        assert "the mask has 3 x 3 pixels" in refusal(load_normals, path, mask=np.ones((3, 3), bool))


def test_commands_print_the_share_and_take_a_mask(tmp_path, capsys):
    write_picture(tmp_path / "n.png", encoded(in_frame(TRUTH.map, "directx"), np.uint16))
    write_picture(tmp_path / "mask.png", 255 * OBJECT.astype(np.uint8))
    map, depth = str(tmp_path / "n.png"), str(tmp_path / "d.npz")
    assert main(["integrate", map, "--out", depth, "--mask", str(tmp_path / "mask.png")]) == 0
    err = capsys.readouterr().err
    assert f"{int(OBJECT.sum())} normals, on 100.0 %" in err and "read as --frame directx" in err
    found = np.load(depth)["depth"]
    assert (np.isfinite(found) == OBJECT).all()
    off = (found - HEIGHT)[OBJECT]
    assert np.abs(off - off.mean()).max() < 0.3
    assert main(["convert", map, "--out", str(tmp_path / "c.png"), "--frame", "directx"]) == 0
    assert error_deg(read(tmp_path / "c.png")[0]) < 0.01


def test_score_takes_pictures(tmp_path, capsys):
    demo = pn.load("demo")
    assert demo.truth is not None
    write_picture(tmp_path / "n.tif", encoded(demo.truth.map, np.uint16) * demo.truth.mask[..., None])
    assert main(["score", "demo", str(tmp_path / "n.tif")]) == 0
    assert capsys.readouterr().out.startswith("mean 0.0")


def test_input_errors_are_one_line():
    with pytest.raises(InputError, match="does not exist"):
        load_normals("nowhere.tga")
