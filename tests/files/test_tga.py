"""TGA comes back as it was written, whatever its order of rows, its depth and its packing."""

import struct

import numpy as np
import pytest

from photonormal.files.decode import decode, decode_all, frame_of
from tests.capture.files import LIGHTS, MASK, refusal, samples, write_folder


def write_tga(path, picture, runs=False, top=False, right=False, note=b"made by hand"):
    """Grey, RGB or RGBA samples (h, w, c), uint8; rows from the bottom, as most programs write them."""
    h, w, c = picture.shape
    rows = picture if top else picture[::-1]
    rows = rows[:, ::-1] if right else rows
    pixels = rows.reshape(-1, c)[:, {1: [0], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[c]]
    kind = (3 if c == 1 else 2) + 8 * runs
    descriptor = (8 if c == 4 else 0) | 0x20 * top | 0x10 * right
    head = struct.pack("<BBBHHBHHHHBB", len(note), 0, kind, 0, 0, 0, 0, 0, w, h, 8 * c, descriptor) + note
    path.write_bytes(head + (packed(pixels) if runs else pixels.tobytes()))
    return path


def packed(pixels):
    """Runs of equal pixels, and single ones, by turns as they come."""
    out, at = b"", 0
    while at < len(pixels):
        same = 1
        while same < 128 and at + same < len(pixels) and (pixels[at + same] == pixels[at]).all():
            same += 1
        out += bytes([0x80 | (same - 1) if same > 1 else 0]) + pixels[at].tobytes()
        at += same
    return out


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize(
    "how", [{}, {"runs": True}, {"top": True}, {"right": True}, {"runs": True, "top": True}], ids=str
)
def test_samples_come_back(tmp_path, channels, how):
    picture = samples(0, np.uint8, channels)
    picture[3:9] = picture[3, 5]  # runs of equal pixels
    path = write_tga(tmp_path / "a.tga", picture, **how)
    np.testing.assert_array_equal(decode_all(path), picture)
    assert frame_of(path) == picture.shape[:2]


def test_a_palette_and_five_bits(tmp_path):
    colours, index = samples(1, np.uint8)[0, :4], np.arange(24, dtype=np.uint8).reshape(4, 6) % 4
    head = struct.pack("<BBBHHBHHHHBB", 0, 1, 1, 0, 4, 24, 0, 0, 6, 4, 8, 0x20)
    (tmp_path / "a.tga").write_bytes(head + colours[:, ::-1].tobytes() + index.tobytes())
    np.testing.assert_array_equal(decode(tmp_path / "a.tga"), colours[index])
    (tmp_path / "b.tga").write_bytes(head + colours[:, ::-1].tobytes() + (index + 1).tobytes())
    assert "colours beyond its 4" in refusal(decode, tmp_path / "b.tga")
    five = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, 2, 1, 16, 0x20)
    (tmp_path / "c.tga").write_bytes(five + struct.pack("<HH", 31 << 10, 31))
    assert decode(tmp_path / "c.tga").tolist() == [[[255, 0, 0], [0, 0, 255]]]


@pytest.mark.parametrize("runs", [False, True])
def test_what_is_cut_short_or_none_is_refused(tmp_path, runs):
    whole = write_tga(tmp_path / "a.tga", samples(0, np.uint8), runs).read_bytes()
    for size in (0, 10, 18, 40, len(whole) // 2, len(whole) - 1):
        (tmp_path / "a.tga").write_bytes(whole[:size])
        assert "but a whole picture is needed" in refusal(decode, tmp_path / "a.tga")
    (tmp_path / "a.tga").write_bytes(b"GIF89a" + bytes(100))
    assert "claims" in refusal(decode, tmp_path / "a.tga")


def test_a_capture_of_tga_pictures(tmp_path):
    import photonormal as pn

    folder = write_folder(tmp_path / "object")
    for j, file in enumerate(sorted(folder.glob("[0-9].png"))):
        file.unlink()
        write_tga(folder / f"{j + 1}.tga", samples(j, np.uint8))
    (folder / "mask.png").unlink()
    write_tga(folder / "object.mask.tga", np.uint8(255) * MASK[..., None])
    capture = pn.load(folder)
    assert capture.images.shape == (len(LIGHTS), 24, 30, 3) and (capture.mask == MASK).all()
    np.testing.assert_allclose(capture.images[1][MASK], samples(1, np.uint8)[MASK] / 255, rtol=1e-6)
