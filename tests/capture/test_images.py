"""Pictures become radiance divided by the light's intensity; masks become True and False."""

import shutil
import tempfile

import numpy as np
import pytest

from photonormal.capture import store
from photonormal.capture.encoding import Encoding
from photonormal.capture.images import ImageFiles, read_mask
from photonormal.files import memory
from photonormal.masked import box_of
from photonormal.srgb import to_linear
from photonormal.types import Capture
from tests.capture.files import LIGHTS, MASK, box, refusal, samples, write_picture

ONE = np.ones((4, 1))


@pytest.fixture
def paths(tmp_path):
    return [write_picture(tmp_path / f"{j}.png", samples(j)) for j in range(4)]


def test_radiance_is_sample_over_full_scale_over_intensity(paths):
    intensities = np.random.default_rng(0).uniform(0.5, 3, (4, 3))
    files = ImageFiles(paths, MASK, intensities)
    assert files.shape == (4, 24, 30, 3) and len(files) == 4
    for j in range(4):
        exact = box(samples(j) / 65535 / intensities[j])
        assert files[j].dtype == np.float32
        np.testing.assert_allclose(files[j], exact, rtol=3e-7)
        np.testing.assert_array_equal(np.rint(files[j] * intensities[j] * 65535), box(samples(j)))  # each of 16 bits


def test_a_second_pass_gives_the_same_without_the_files(paths):
    files = ImageFiles(paths, MASK, ONE)
    first = [files[j] for j in range(4)]
    for path in paths:
        path.unlink()
    for j in range(4):
        np.testing.assert_array_equal(files[j], first[j])


def test_beyond_the_memory_allowed_a_scratch_file_keeps_them(paths, monkeypatch, tmp_path):
    kept = ImageFiles(paths, None, ONE)
    monkeypatch.setattr(memory, "holds", lambda nbytes: False)
    monkeypatch.setattr(store, "SIDE", 7)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    files = ImageFiles(paths, None, ONE)
    before = set(tmp_path.iterdir())
    for j in range(4):
        np.testing.assert_array_equal(files[j], kept[j])
    for path in paths:
        path.unlink()
    some = (0, 3), (5, 23), (13, 14), (2, 24, 3), (8, 22, 5), (1, 24, 16)
    for rows, columns in ((slice(*rows), slice(*columns)) for rows in some for columns in ((0, 30), (6, 21))):
        np.testing.assert_array_equal(files.window(2, rows, columns), kept[2][rows, columns])
    assert set(tmp_path.iterdir()) <= before  # it has no name: nothing is left after a crash


def test_no_room_for_the_scratch_file(paths, monkeypatch):
    monkeypatch.setattr(memory, "holds", lambda nbytes: False)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: shutil._ntuple_diskusage(10**6, 10**6, 1000))
    files = ImageFiles(paths, None, ONE)
    assert "a scratch file of" in (said := refusal(files.__getitem__, 0)) and "--memory" in said, said


EVERY = tuple((slice(first, 24, step), slice(3, 30)) for first in (0, 1, 20) for step in (2, 5, 30))  # rows


@pytest.mark.parametrize("mask", [None, MASK])
def test_windows_are_parts_of_pictures(paths, mask):
    files = ImageFiles(paths, mask, ONE)
    whole = (slice(0, 24), slice(0, 30)), (slice(2, 11), slice(12, 40)), (slice(0, 2), slice(0, 2))
    for rows, columns in (*whole, *EVERY):
        np.testing.assert_array_equal(files.window(1, rows, columns), files[1][rows, columns])


def test_images_own_their_memory(paths):
    files = ImageFiles(paths, MASK, ONE)
    files[0][:] = 7
    assert files[0].max() <= 1


def test_threads_read_what_one_reads(tmp_path):
    paths = [write_picture(tmp_path / f"{j}.png", samples(j)) for j in range(40)]
    files, again = ImageFiles(paths, MASK, np.ones((40, 1))), ImageFiles(paths, MASK, np.ones((40, 1)))
    capture = Capture(files, MASK, np.tile(LIGHTS, (10, 1)))
    for _ in range(2):
        for j, image in enumerate(capture.map_images(lambda j, image: image)):
            np.testing.assert_array_equal(image, again[j])


def test_a_grey_picture_takes_the_mean_of_the_colours_intensities(tmp_path):
    paths = [write_picture(tmp_path / "a.png", samples(0, np.uint8, 1))]
    np.testing.assert_allclose(
        ImageFiles(paths, None, np.array([[1.0, 2.0, 6.0]]))[0], samples(0, np.uint8, 1) / 255 / 3, rtol=1e-6
    )


def test_a_sample_at_full_scale_is_saturated(paths):
    files = ImageFiles(paths, None, 2 * np.ones((4, 3)))
    assert files.saturation is not None
    assert (files[1] >= files.saturation[1] * (1 - 1e-6)).sum() == (samples(1) == 65535).sum() >= 3


def test_floats_need_not_saturate(tmp_path):
    path = write_picture(tmp_path / "a.exr", 7 * samples(0, np.float32))
    files = ImageFiles([path], None, ONE[:1])
    assert files.saturation is None
    np.testing.assert_array_equal(files[0], 7 * samples(0, np.float32))


class TestEncoded:
    def test_known_values_of_the_standard(self):
        encoded = np.array([0, 0.04045, 0.5, 1])
        np.testing.assert_allclose(to_linear(encoded), [0, 0.0031308, 0.2140411, 1], rtol=1e-5)

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_samples_are_linearised_before_the_division(self, tmp_path, dtype):
        path = write_picture(tmp_path / "a.png", samples(0, dtype))
        full = np.iinfo(dtype).max
        np.testing.assert_allclose(
            ImageFiles([path], None, np.array([[1.0, 2.0, 4.0]]), encodings=[Encoding((to_linear,))])[0],
            to_linear(samples(0, dtype) / full) / np.array([1, 2, 4]),
            rtol=1e-6,
        )

    def test_floats_are_linear(self, tmp_path):
        path = write_picture(tmp_path / "a.exr", samples(0, np.float32))
        np.testing.assert_array_equal(
            ImageFiles([path], None, ONE[:1], encodings=[Encoding((to_linear,))])[0], samples(0, np.float32)
        )


class TestSums:
    def test_parts_of_a_picture_are_added(self, paths):
        files = ImageFiles([(paths[0], paths[1]), (paths[2], paths[3])], None, np.ones((2, 1)))
        np.testing.assert_allclose(files[1], (samples(2).astype(float) + samples(3)) / 65535, rtol=1e-6)

    def test_parts_of_two_sizes(self, tmp_path, paths):
        small = write_picture(tmp_path / "small.png", samples()[:20])
        assert "30 x 20 pixels but 30 x 24 pixels are needed" in refusal(ImageFiles, [(paths[0], small)], None, ONE[:1])


@pytest.mark.parametrize(
    ("other", "came"),
    [
        (samples()[:, :29], "29 x 24 pixels"),
        (samples()[..., :1], "30 x 24 pixels of one channel, 16-bit samples"),
        (samples(0, np.uint8), "30 x 24 pixels of 3 channels, 8-bit samples"),
    ],
)
def test_pictures_of_two_kinds(tmp_path, paths, other, came):
    path = write_picture(tmp_path / "other.png", other)
    message = refusal(ImageFiles([*paths, path], MASK, np.ones((5, 1))).__getitem__, 4)
    assert came in message and "30 x 24 pixels" in message and "other.png" in message


def test_pictures_that_are_white_all_over_are_called_overexposed(tmp_path):
    white = [write_picture(tmp_path / f"{j}.png", np.full((*MASK.shape, 3), 255, np.uint8)) for j in range(2)]
    files = ImageFiles(white, MASK, np.ones((2, 1)), distinct=True)
    assert "0.png and 1.png are white all over the object; expose less" in refusal(lambda: [files[0], files[1]])


class TestMasks:
    @pytest.mark.parametrize("white", [1, 3, 255])
    def test_any_white(self, tmp_path, white):
        path = write_picture(tmp_path / "mask.png", MASK.astype(np.uint8) * np.uint8(white))
        np.testing.assert_array_equal(read_mask(path), MASK)

    @pytest.mark.parametrize("suffix", [".png", ".tif", ".npy", ".exr", ".bmp"])
    def test_formats(self, tmp_path, suffix):
        dtype = np.float32 if suffix == ".exr" else np.uint8
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / f"mask{suffix}", MASK.astype(dtype))), MASK)

    def test_bools(self, tmp_path):
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / "mask.npy", MASK)), MASK)

    @pytest.mark.parametrize("shade", [0, 40, "photograph"])
    def test_a_thing_that_was_cut_out_is_where_it_is_opaque(self, tmp_path, shade):
        grey = (
            np.arange(MASK.size).reshape(MASK.shape) * 7 % 251 if shade == "photograph" else np.full(MASK.shape, shade)
        )
        picture = np.stack([grey, grey, grey, 255 * MASK], axis=-1).astype(np.uint8)
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / "mask.png", picture)), MASK)

    def test_jpeg_ringing_is_no_object(self, tmp_path):
        path = write_picture(tmp_path / "mask.jpg", MASK.astype(np.uint8) * 255)
        np.testing.assert_array_equal(read_mask(path), MASK)

    def test_one_colour_is_enough(self, tmp_path):
        red = np.zeros((24, 30, 3), np.uint8)
        red[MASK, 0] = 255
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / "mask.png", red)), MASK)

    def test_what_is_transparent_is_not_the_object(self, tmp_path):
        cut = np.full((24, 30, 4), 255, np.uint8)
        cut[..., 3] = MASK * 255
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / "mask.png", cut)), MASK)

    def test_white_on_opaque_black(self, tmp_path):
        opaque = np.repeat(MASK[..., None], 4, axis=2).astype(np.uint8) * 255
        opaque[..., 3] = 255
        np.testing.assert_array_equal(read_mask(write_picture(tmp_path / "mask.png", opaque)), MASK)

    def test_black_is_empty(self, tmp_path):
        assert not read_mask(write_picture(tmp_path / "mask.png", 0 * MASK.astype(np.uint8))).any()


class TestBox:
    def test_it_is_the_smallest(self):
        assert box_of(MASK) == (slice(9, 14), slice(10, 18))

    def test_a_margin_stays_in_the_frame(self):
        assert box_of(MASK, 11) == (slice(0, 24), slice(0, 29))

    def test_of_nothing_it_is_all(self):
        assert box_of(MASK & False, 2) == (slice(0, 24), slice(0, 30))
