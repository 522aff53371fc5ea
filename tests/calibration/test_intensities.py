"""Intensities of lights: from a board, from the object's own shading, from Exif."""

import struct

import numpy as np
import pytest

import photonormal as pn
from photonormal.calibration.intensities import from_reference, linear_intensities, self_calibrated
from photonormal.capture.exif import exposures, read_exif
from photonormal.cli import main
from photonormal.types import InputError
from tests.calibration.chrome import dome, write_pictures
from tests.scenes import lambertian, sphere, write_diligent


@pytest.fixture(scope="module")
def scene():
    """Grey levels (p, n) of a matt sphere with attached shadows, lights, and intensities that were put in."""
    L = dome(12, 60.0)
    e = np.exp(np.random.default_rng(1).normal(0, 0.3, 12))
    capture = lambertian(sphere(), L)
    return np.asarray(capture.images)[:, capture.mask][..., 0].T * e, L, e / np.exp(np.log(e).mean())


def test_intensities_come_out_of_the_object_s_shading(scene):
    I, L, e = scene
    found, b = self_calibrated(I[::3], L)
    assert np.abs(np.log(found / e)).max() < 0.02
    assert np.allclose(np.linalg.norm(b, axis=1), np.linalg.norm(b, axis=1).mean(), rtol=0.05)  # one albedo


def test_a_tenth_of_bright_outliers_changes_little(scene):
    I, L, e = scene
    rng = np.random.default_rng(0)
    J = np.where(rng.random(I.shape) < 0.1, I + rng.random(I.shape), I)
    assert np.abs(np.log(self_calibrated(J[::2], L)[0] / e)).max() < 0.06


def test_without_shadows_the_linear_solution_is_exact(scene):
    I, L, e = scene
    lit = (I > 0).all(1)
    assert np.abs(np.log(linear_intensities(I[lit], L) / e)).max() < 1e-3


def test_a_board_that_faces_the_camera_shows_the_cosine(scene):
    _, L, e = scene
    levels = (e * L[:, 2])[:, None] * np.array([[0.5, 0.4, 0.3]])
    found = from_reference(levels, "board", np.array([0.0, 0, 1]), L)
    assert np.allclose(found / found.mean(0), (e / e.mean())[:, None])
    assert np.allclose(found.mean(0) / found.mean(), [1.25, 1.0, 0.75])  # the lights' colour is kept


def test_a_black_board_and_a_grazing_light_are_refused():
    with pytest.raises(InputError, match="picture 2 of board is black"):
        from_reference(np.array([[1.0], [0.0]]), "board")
    with pytest.raises(InputError, match="light 2 grazes or misses board"):
        from_reference(np.ones((2, 1)), "board", np.array([0, 0, 1.0]), np.array([[0, 0, 1.0], [1, 0, 0]]))


def unequal(folder, gains) -> None:
    """A capture whose pictures are `gains` times as bright."""
    capture = lambertian(sphere(), dome(9, 50.0), albedo=0.5)
    images = np.asarray(capture.images) * np.asarray(gains, np.float32)[:, None, None, None]
    write_diligent(folder, pn.Capture(images, capture.mask, capture.lights, truth=capture.truth))


GAINS = [1.0, 1.4, 0.6, 0.9, 1.2, 0.5, 1.1, 0.8, 1.3]


@pytest.mark.parametrize("how", ["object", "board", "region"])
def test_the_command_makes_measuring_exact_again(tmp_path, capsys, how):
    unequal(tmp_path / "object", GAINS)
    board = 60 * np.array(GAINS) * dome(9, 50.0)[:, 2]
    write_pictures(tmp_path / "board", [np.full((48, 48), np.rint(v * 2), np.uint8) for v in board])
    given = {
        "object": [],
        "board": ["--reference", tmp_path / "board"],
        "region": ["--reference", tmp_path / "board", "--region", "5,5,20,20"],
    }[how]
    out = tmp_path / "light_intensities.txt"
    assert main(["intensities", str(tmp_path / "object"), "--out", str(out), *map(str, given)]) == 0
    e = np.loadtxt(out, ndmin=2)[:, 0]
    assert np.abs(np.log(e / np.array(GAINS) * np.mean(GAINS) / e.mean())).max() < 0.03
    before = pn.load(tmp_path / "object")
    after = pn.load(tmp_path / "object", intensities=out)
    errors = [pn.score(pn.solve(c, "trimmed"), before.truth).mean_deg for c in (before, after)]
    assert errors[1] < 0.8 < 4 < errors[0]


def jpeg(path, seconds: tuple[int, int] | None, iso: int | None = 100, srgb: bool = True, level: int = 128) -> None:
    """A JPEG with the Exif data that cameras write."""
    import cv2

    entries = [(0x829A, 5, 1, seconds)] if seconds else []
    entries += [(0x8827, 3, 1, iso)] if iso else []
    entries += [(0xA001, 3, 1, 1 if srgb else 0xFFFF)]
    at = 8 + 2 + 12 + 4  # the second directory
    data = at + 2 + 12 * len(entries) + 4
    tiff = struct.pack("<2sHI", b"II", 42, 8) + struct.pack("<HHHIII", 1, 0x8769, 4, 1, at, 0)
    tiff += struct.pack("<H", len(entries))
    for tag, kind, count, value in entries:
        tiff += struct.pack("<HHII", tag, kind, count, data if kind == 5 else value)
    tiff += struct.pack("<I", 0) + (struct.pack("<II", *seconds) if seconds else b"")
    picture = cv2.imencode(".jpg", np.full((16, 16), level, np.uint8))[1].tobytes()
    block = b"Exif\0\0" + tiff
    path.write_bytes(picture[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + picture[2:])


def test_exif_tells_exposures(tmp_path):
    for j, (seconds, iso) in enumerate([((1, 50), 100), ((1, 100), 400), ((1, 25), 100)]):
        jpeg(tmp_path / f"{j}.jpg", seconds, iso)
    found = exposures([tmp_path / f"{j}.jpg" for j in range(3)])
    assert np.allclose(found[:, 0] / found[0, 0], [1, 2, 2])
    assert read_exif(tmp_path / "0.jpg").colour_space == "sRGB"


def test_pictures_without_exposure_data_are_refused(tmp_path):
    jpeg(tmp_path / "0.jpg", (1, 50))
    for j in (1, 2):
        jpeg(tmp_path / f"{j}.jpg", None)
    with pytest.raises(InputError, match=r"1.jpg and 1 more have no exposure time .* light_intensities.txt"):
        exposures([tmp_path / f"{j}.jpg" for j in range(3)])


def test_a_mixture_with_and_without_iso_is_refused(tmp_path):
    jpeg(tmp_path / "0.jpg", (1, 50), None)
    jpeg(tmp_path / "1.jpg", (1, 50), 200)
    with pytest.raises(InputError, match="some pictures name their iso"):
        exposures([tmp_path / "0.jpg", tmp_path / "1.jpg"])


@pytest.mark.parametrize(
    "data", [b"", b"\xff\xd8\xff\xe1\x00\x20Exif\0\0II*\0\xff\xff\xff\xff", b"II*\0\x08\0\0\0\xff\xff"]
)
def test_damaged_exif_is_no_exif(tmp_path, data):
    (tmp_path / "a.jpg").write_bytes(data)
    assert read_exif(tmp_path / "a.jpg").exposure() is None


def test_jpegs_that_declare_srgb_are_linearised_unless_told_otherwise(tmp_path):
    for j in range(4):
        jpeg(tmp_path / f"{j}.jpg", (1, 50), level=128 + j)
    np.savetxt(tmp_path / "light_directions.txt", dome(4))
    value = 128 / 255
    assert pn.load(tmp_path).images[0].mean() == pytest.approx(((value + 0.055) / 1.055) ** 2.4, abs=2e-3)
    assert pn.load(tmp_path, linear=True).images[0].mean() == pytest.approx(value, abs=2e-3)


def test_exif_exposures_divide_the_pictures(tmp_path):
    for j, denominator in enumerate((50, 100, 25)):
        jpeg(tmp_path / f"{j}.jpg", (1, denominator), level=128 + j)
    np.savetxt(tmp_path / "light_directions.txt", [[0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]])
    plain, images = (pn.load(tmp_path, exif_exposure=divided).images for divided in (False, True))
    gain = [images[j].mean() / plain[j].mean() for j in range(3)]
    assert gain[1] / gain[0] == pytest.approx(2) and gain[2] / gain[0] == pytest.approx(0.5)


def test_exposures_that_differ_are_told_until_something_divides_by_them(tmp_path, capsys):
    for j, denominator in enumerate((50, 100, 25)):
        jpeg(tmp_path / f"{j}.jpg", (1, denominator), level=128 + j)
    np.savetxt(tmp_path / "light_directions.txt", [[0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]])
    (note,) = pn.load(tmp_path).notes
    assert "2.jpg 4 times as much as 1.jpg" in note and "--exif-exposure" in note
    main(["check", str(tmp_path), "--linear"])
    assert f"next: photonormal measure {tmp_path} --exif-exposure --linear --out result" in capsys.readouterr().out
    assert not pn.load(tmp_path, exif_exposure=True).notes
    assert not pn.load(tmp_path, lights="unknown").notes
    np.savetxt(tmp_path / "light_intensities.txt", [2, 1, 4])
    assert not pn.load(tmp_path).notes


@pytest.mark.parametrize(("boards", "gains"), [((50, 50, 50), (2, 0.5)), ((50, 100, 25), (1, 1))])
def test_exposures_of_pictures_and_of_their_boards_both_count(tmp_path, boards, gains):
    for j, exposed in enumerate(zip((50, 100, 25), boards, strict=True)):
        for place, denominator in zip((tmp_path, tmp_path / "white"), exposed, strict=True):
            place.mkdir(exist_ok=True)
            jpeg(place / f"{j}.jpg", (1, denominator), level=128 + j)
    np.savetxt(tmp_path / "light_directions.txt", [[0, 0, 1], [0.5, 0, 1], [0, 0.5, 1]])
    plain, images = (pn.load(tmp_path, flat=tmp_path / "white", exif_exposure=e).images for e in (False, True))
    gain = [images[j].mean() / plain[j].mean() for j in range(3)]
    assert [gain[1] / gain[0], gain[2] / gain[0]] == pytest.approx(gains, rel=1e-4)
