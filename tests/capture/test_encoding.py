"""How samples are encoded is what the files say, whatever their names; the user's word counts before."""

import json

import numpy as np
import pytest

import photonormal as pn
from photonormal.capture.exif import read_exif
from photonormal.cli import main
from photonormal.doctor import findings_of
from photonormal.srgb import to_linear
from tests.capture.embedding import ADOBE, SRGB, curv, exif, profile, write_with
from tests.capture.files import LIGHTS, refusal, samples
from tests.scenes import lambertian, ring, sphere

GAMMA = profile(*3 * [curv(563)], name="Adobe RGB (1998)")


def folder(path, n=4, suffix=".png", dtype: type = np.uint8, channels=3, **embedded):
    """Pictures 1 to n and their lights."""
    for j in range(n):
        write_with(path / f"{j + 1}{suffix}", samples(j, dtype, channels), **embedded)
    np.savetxt(path / "light_directions.txt", LIGHTS[:n])
    return path


def levels(j=0, dtype: type = np.uint8, channels=3):
    return samples(j, dtype, channels) / np.iinfo(dtype).max


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("kind", "suffix"), [(".jpg", ".png"), (".jpg", ".jpg"), (".png", ".png"), (".png", ".jpg")])
def test_exif_counts_by_content(tmp_path, kind, suffix, order):
    capture = pn.load(folder(tmp_path, suffix=suffix, kind=kind, exif=exif(SRGB, order=order)))
    plain = pn.load(tmp_path, linear=True)
    assert capture.encoding == "sRGB (Exif)" and capture.linearised and not plain.linearised
    np.testing.assert_allclose(capture.images[2], to_linear(np.asarray(plain.images[2])), atol=1e-6)


@pytest.mark.parametrize("block", [exif(ADOBE), exif(0xFFFF, rules=b"R03\0")])
def test_cameras_that_were_set_to_adobe_rgb(tmp_path, block):
    capture = pn.load(folder(tmp_path, exif=block))
    np.testing.assert_allclose(capture.images[1], levels(1) ** (563 / 256), atol=1e-6)
    assert "Adobe RGB" in capture.encoding


def test_uncalibrated_says_nothing(tmp_path):
    capture = pn.load(folder(tmp_path, exif=exif(0xFFFF)))
    np.testing.assert_allclose(capture.images[1], levels(1), atol=1e-6)
    assert not capture.linearised and capture.encoding.startswith("linear (nothing")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".tif", ".png"])
def test_profiles_keep_every_bit(tmp_path, suffix, dtype):
    capture = pn.load(folder(tmp_path, suffix=suffix, dtype=dtype, profile=GAMMA))
    np.testing.assert_allclose(capture.images[3], levels(3, dtype) ** (563 / 256), atol=1e-6)
    assert capture.encoding == "gamma 2.2 (the profile Adobe RGB (1998))"


def test_of_a_profile_s_matrix_nothing_is_applied(tmp_path):
    """ProPhoto's wide primaries leave linear samples as they are: they mix channels and change no shading."""
    prophoto = np.array([[0.7977, 0.1352, 0.0313], [0.2880, 0.7119, 0.0001], [0.0, 0.0, 0.8249]])
    data = profile(*3 * [curv(461)], name="ProPhoto RGB", primaries=prophoto)
    capture = pn.load(folder(tmp_path, suffix=".tif", dtype=np.uint16, profile=data))
    np.testing.assert_allclose(capture.images[3], levels(3, np.uint16) ** (461 / 256), atol=1e-6)


def test_a_jpeg_s_profile_comes_in_parts_and_counts_before_exif(tmp_path):
    table = np.rint(65535 * np.linspace(0, 1, 1024) ** 1.8).astype(int).tolist()
    data = profile(*3 * [curv(*table)])
    capture = pn.load(folder(tmp_path, suffix=".jpg", profile=data, exif=exif(SRGB)))
    plain = np.asarray(pn.load(tmp_path, linear=True).images[0])
    np.testing.assert_allclose(capture.images[0], plain**1.8, atol=1e-4)


def test_grey_pictures_and_curves_of_each_channel(tmp_path):
    grey = pn.load(folder(tmp_path / "grey", suffix=".tif", dtype=np.uint16, channels=1, profile=profile(curv(512))))
    np.testing.assert_allclose(grey.images[0], levels(0, np.uint16, 1) ** 2, atol=1e-6)
    each = folder(tmp_path / "each", suffix=".tif", profile=profile(curv(256), curv(512), curv(768)))
    np.testing.assert_allclose(pn.load(each).images[0], levels() ** np.array([1, 2, 3]), atol=1e-6)
    split = pn.load(each, rgb_lights=True, images="1-4", lights=_twelve(tmp_path))
    np.testing.assert_allclose(split.images[2][..., 0], levels()[..., 2] ** 3, atol=1e-6)


def _twelve(path):
    np.savetxt(path / "twelve.txt", ring(11, 40))
    return path / "twelve.txt"


def test_a_linear_profile_is_told(tmp_path):
    capture = pn.load(folder(tmp_path, suffix=".tif", profile=profile(*3 * [curv()], name="Linear")))
    np.testing.assert_allclose(capture.images[0], levels(), atol=1e-6)
    assert capture.encoding == "linear (the profile Linear)" and not capture.linearised


def test_a_profile_without_curves_is_not_applied_and_told(tmp_path):
    capture = pn.load(folder(tmp_path, suffix=".tif", profile=profile()))
    assert "not applied" in capture.encoding and any("no tone curves" in note for note in capture.notes)


def test_jpeg_files_that_say_nothing_are_told(tmp_path):
    capture = pn.load(folder(tmp_path, suffix=".jpg"))
    assert any("4 photographs are JPEG files" in note and "--srgb" in note for note in capture.notes)
    assert not capture.linearised
    for how in ({"srgb": True}, {"linear": True}):
        assert not pn.load(tmp_path, **how).notes
    assert not pn.load(folder(tmp_path / "said", suffix=".jpg", exif=exif(SRGB))).notes


def test_the_user_s_word_counts_before_the_files(tmp_path):
    folder(tmp_path, suffix=".tif", profile=GAMMA)
    np.testing.assert_allclose(pn.load(tmp_path, srgb=True).images[0], to_linear(levels()), atol=1e-6)
    np.testing.assert_allclose(pn.load(tmp_path, linear=True).images[0], levels(), atol=1e-6)
    assert "drop one" in refusal(pn.load, tmp_path, srgb=True, linear=True)


def test_a_picture_that_says_nothing_among_others_is_refused(tmp_path):
    folder(tmp_path, exif=exif(SRGB))
    write_with(tmp_path / "1.png", samples(0, np.uint8))
    message = refusal(pn.load, tmp_path)
    assert message.startswith("1.png ") and "--srgb" in message and "--linear" in message
    assert pn.load(tmp_path, images="2-4").linearised


def test_each_picture_has_its_own(tmp_path):
    folder(tmp_path, exif=exif(SRGB))
    write_with(tmp_path / "3.png", samples(2, np.uint8), profile=GAMMA)
    capture = pn.load(tmp_path)
    np.testing.assert_allclose(capture.images[1], to_linear(levels(1)), atol=1e-6)
    np.testing.assert_allclose(capture.images[2], levels(2) ** (563 / 256), atol=1e-6)
    assert capture.encoding.startswith("3 pictures sRGB (Exif), 1 ")


def test_a_dark_frame_of_another_depth_is_linearised_by_its_own(tmp_path):
    folder(tmp_path, suffix=".tif", profile=GAMMA)
    dark = write_with(tmp_path / "dark.tif", np.full((24, 30, 3), 13107, np.uint16), profile=GAMMA)
    found = pn.load(tmp_path, dark=dark).images[0]
    np.testing.assert_allclose(found, np.maximum(levels() ** (563 / 256) - 0.2 ** (563 / 256), 0), atol=1e-6)


def test_a_file_s_exif_is_found_wherever_its_directory_lies(tmp_path):
    """TIFF writers may put the directory behind the samples."""
    start = b"II*\0" + (2 * 2**20).to_bytes(4, "little")
    block = exif(SRGB)
    shift = 2 * 2**20 - 8
    entry = block[8:-4].replace(
        (8 + 2 + 12 + 4).to_bytes(4, "little"), (8 + 2 + 12 + 4 + shift).to_bytes(4, "little"), 1
    )
    (tmp_path / "a.tif").write_bytes(start + bytes(shift) + entry + bytes(4))
    assert read_exif(tmp_path / "a.tif").colour_space == "sRGB"


def matt(path, dtype: type, encoded: bool, **embedded):
    """A matt sphere under a ring, its samples with gamma 2.2 or linear."""
    L = ring(9, 45)
    capture = lambertian(sphere(48), L)
    full = np.iinfo(dtype).max
    for j, image in enumerate(np.asarray(capture.images)):
        x = (0.8 * image / np.asarray(capture.images).max()).clip(0, 1) ** (256 / 563 if encoded else 1)
        write_with(path / f"{j + 1}.tif", np.rint(full * np.repeat(x[..., :1], 3, -1)).astype(dtype), **embedded)
    write_with(path / "mask.png", np.repeat(capture.mask[..., None], 3, -1).astype(np.uint8) * 255)
    np.savetxt(path / "light_directions.txt", L)
    return path


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_fits_better_linearised_is_told_unless_it_was(tmp_path, dtype):
    silent, said, linear = (tmp_path / name for name in ("silent", "said", "linear"))
    found = findings_of(pn.load(matt(silent, dtype, True)))
    assert [f.kind for f in found if f.grave] == ["encoding"] and "--srgb" in found[0].message
    assert not [f for f in findings_of(pn.load(matt(said, dtype, True, profile=GAMMA))) if f.grave]
    assert not [f for f in findings_of(pn.load(matt(linear, dtype, False))) if f.grave]


def test_what_fits_better_as_it_was_is_told(tmp_path):
    """Editors write sRGB's profile into linear pictures, too."""
    matt(tmp_path, np.uint16, False, profile=GAMMA)
    found = findings_of(pn.load(tmp_path))
    assert [f.kind for f in found if f.grave] == ["encoding"] and "--linear" in found[0].message
    assert not [f for f in findings_of(pn.load(tmp_path, linear=True)) if f.grave]


def test_the_report_says_what_was_assumed(tmp_path, capsys):
    arguments = ["--method", "woodham", "--no-mesh", "--no-expected-error"]
    for name, embedded in (("silent", {}), ("said", {"profile": GAMMA})):
        path = matt(tmp_path / name, np.uint16, True, **embedded)
        assert main(["measure", str(path), "--out", str(tmp_path / f"{name}-out"), *arguments]) == 0
        assert ("--srgb" in capsys.readouterr().err) is (name == "silent")
    said = {n: json.loads((tmp_path / f"{n}-out" / "report.json").read_text()) for n in ("silent", "said")}
    assert said["silent"]["encoding"] == "linear (nothing in the files says otherwise)"
    assert said["said"]["encoding"] == "gamma 2.2 (the profile Adobe RGB (1998))"
