"""A picture file gives back its samples, all bits of them, or one line that says what is wrong with it."""

import os
import pickle
import struct
import sys
import zlib

import numpy as np
import pytest

from photonormal.files.decode import decode, decode_all
from photonormal.files.plain import PNG_START
from tests.capture.files import refusal, samples, write_picture

U8, U16, F16, F32 = np.uint8, np.uint16, np.float16, np.float32


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [
        (".png", U8),
        (".png", U16),
        (".bmp", U8),
        (".tif", U8),
        (".TIFF", U16),
        (".tif", F32),
        (".npy", U8),
        (".npy", U16),
        (".npy", np.float64),
        (".exr", F16),
        (".exr", F32),
    ],
)
def test_every_bit_comes_back(tmp_path, suffix, dtype, channels):
    if suffix == ".bmp" and channels == 4:
        pytest.skip("OpenCV writes no alpha in BMP")
    picture = samples(0, dtype, channels)
    decoded = decode(write_picture(tmp_path / f"a{suffix.lower()}", picture).rename(tmp_path / f"b{suffix}"))
    assert decoded.dtype == (dtype if np.dtype(dtype).kind == "u" else F32)
    np.testing.assert_array_equal(decoded, picture[..., : 1 if channels == 1 else 3].astype(decoded.dtype))


def test_alpha_is_kept_for_masks(tmp_path):
    picture = samples(0, U16, 4)
    np.testing.assert_array_equal(decode_all(write_picture(tmp_path / "a.png", picture)), picture)


def test_a_jpeg_is_near_what_was_saved(tmp_path):
    smooth = np.linspace(20, 200, 24 * 30 * 3).reshape(24, 30, 3).astype(U8)
    assert np.abs(decode(write_picture(tmp_path / "a.jpg", smooth)).astype(int) - smooth).max() < 12


def test_content_counts_not_the_name(tmp_path):
    picture = samples(0, U16)
    np.testing.assert_array_equal(
        decode(write_picture(tmp_path / "a.png", picture).rename(tmp_path / "b.jpg")), picture
    )


class TestTiff:
    @pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
    @pytest.mark.parametrize(
        "options", [{}, {"planarconfig": "separate"}, {"byteorder": ">"}, {"tile": (16, 16)}], ids=str
    )
    @pytest.mark.parametrize("dtype", [U16, F32])
    def test_storage_does_not_matter(self, tmp_path, compression, options, dtype):
        pytest.importorskip("imagecodecs")  # to write LZW
        picture = stored = samples(0, dtype)
        if "planarconfig" in options:
            stored = np.moveaxis(picture, -1, 0)
        import tifffile

        path = tmp_path / "a.tif"
        tifffile.imwrite(
            path, stored, photometric="rgb", compression=compression, predictor=bool(compression), **options
        )
        np.testing.assert_array_equal(decode(path), picture)

    @pytest.mark.parametrize(("compression", "dtype"), [("zlib", F32), ("lzw", U8), ("lzw", U16), ("lzw", F32)])
    def test_opencv_stands_in_for_imagecodecs(self, tmp_path, monkeypatch, compression, dtype):
        pytest.importorskip("imagecodecs")
        path, picture = tmp_path / "a.tif", samples(0, dtype)
        write_picture(path, picture, compression=compression, predictor=True)
        monkeypatch.setattr("tifffile.TiffPage.asarray", _needs_imagecodecs)
        np.testing.assert_array_equal(decode(path), picture)

    def test_a_compression_that_nothing_here_reads(self, tmp_path, monkeypatch):
        path = write_picture(tmp_path / "a.tif", samples(), compression="lzma")
        monkeypatch.setattr("tifffile.TiffPage.asarray", _needs_imagecodecs)
        assert "pip install imagecodecs" in refusal(decode, path)

    def test_white_is_zero_in_miniswhite(self, tmp_path):
        picture = samples(0, U8, 1)
        decoded = decode(write_picture(tmp_path / "a.tif", picture, photometric="miniswhite"))
        np.testing.assert_array_equal(decoded, 255 - picture)

    def test_bilevel(self, tmp_path):
        import tifffile

        picture = samples(0, U8, 1)[..., 0] > 100
        tifffile.imwrite(tmp_path / "a.tif", picture, photometric="minisblack")
        np.testing.assert_array_equal(decode(tmp_path / "a.tif")[..., 0], picture * 255)

    def test_a_palette_is_no_radiance(self, tmp_path):
        colours = np.arange(768, dtype=U16).reshape(3, 256)
        path = write_picture(tmp_path / "a.tif", samples(0, U8, 1), photometric="palette", colormap=colours)
        assert "PALETTE" in refusal(decode, path)

    def test_a_stack_is_no_picture(self, tmp_path):
        import tifffile

        tifffile.imwrite(tmp_path / "a.tif", np.zeros((3, 24, 30), U16), photometric="minisblack")
        assert "holds 3 pages but one is needed" in refusal(decode, tmp_path / "a.tif")


def _needs_imagecodecs(page):
    raise ValueError(f"<COMPRESSION.{page.compression.name}> requires the 'imagecodecs' package")


class TestRaw:
    def test_samples_stay_proportional_to_light(self, tmp_path):
        """The same scale for every picture, whatever its brightest sample; no white balance, no curve."""
        pytest.importorskip("rawpy")
        for bright in (2000, 4000, 15000):
            path = _write_dng(tmp_path / "a.dng", bright, 1000, 500)
            np.testing.assert_allclose(
                decode(path)[8:-8, 8:-8],
                np.broadcast_to(np.array([bright, 1000, 500]) * 65535 / 16383, (48, 80, 3)),
                atol=4,
            )

    def test_it_is_linear_already(self, tmp_path):
        pytest.importorskip("rawpy")
        from photonormal.capture.encoding import encodings
        from photonormal.capture.images import ImageFiles

        path = _write_dng(tmp_path / "a.dng", 4000, 1000, 500)
        plain, encoded = (
            ImageFiles([path], None, np.ones((1, 1)), encodings([path], srgb))[0] for srgb in (False, True)
        )
        np.testing.assert_array_equal(plain, encoded)

    def test_junk(self, tmp_path, capfd):
        pytest.importorskip("rawpy")
        (tmp_path / "a.nef").write_bytes(b"junk" * 100)
        assert "can't be decoded" in refusal(decode, tmp_path / "a.nef")

    def test_rawpy_is_named_where_it_is_absent(self, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "rawpy", None)
        (tmp_path / "a.CR2").write_bytes(b"II*\0")
        assert "pip install 'photonormal[raw]'" in refusal(decode, tmp_path / "a.CR2")


def _write_dng(path, red: int, green: int, blue: int):
    """A Bayer mosaic of one colour, 14 bits, as a digital negative."""
    import tifffile

    mosaic = np.full((64, 96), green, U16)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = red, blue
    identity = (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1)
    tags = [
        (271, "s", 0, "photonormal", True),
        (272, "s", 0, "test", True),
        (33421, "H", 2, (2, 2), True),  # pattern: size, then red green / green blue
        (33422, "B", 4, bytes([0, 1, 1, 2]), True),
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),  # DNG version
        (50708, "s", 0, "photonormal test", True),
        (50714, "I", 1, 0, True),  # black, white
        (50717, "I", 1, 16383, True),
        (50721, "2i", 9, identity, True),  # colour matrix, neutral, illuminant
        (50728, "2I", 3, (2, 1, 1, 1, 1, 1), True),
        (50778, "H", 1, 21, True),
    ]
    tifffile.imwrite(path, mosaic, photometric=32803, metadata=None, software=False, subfiletype=0, extratags=tags)
    return path


class TestDamage:
    """Truncated and foreign files are refused quietly; OpenCV alone would fill in grey or print."""

    @pytest.mark.parametrize("left", [0, 3, 20, 200, 0.5, -1, -13])
    @pytest.mark.parametrize(
        "name", ["a.png", "a.jpg", "planar.tif", "a.tif", "packed.tif", "a.npy", "a.bmp", "8bit.png", "grey.jpeg"]
    )
    def test_truncated(self, tmp_path, capfd, name, left):
        path, dtype = tmp_path / name, U16 if name.endswith((".png", ".tif", ".npy")) and name != "8bit.png" else U8
        picture = samples(0, dtype, 1 if "grey" in name else 3)
        if name == "planar.tif":
            import tifffile

            tifffile.imwrite(path, np.moveaxis(picture, -1, 0), photometric="rgb", planarconfig="separate")
        else:
            write_picture(path, picture, **({"compression": "zlib"} if name == "packed.tif" else {}))
        data = path.read_bytes()
        path.write_bytes(data[: int(left * len(data)) if isinstance(left, float) else left])
        assert str(path) in refusal(decode, path)
        assert capfd.readouterr() == ("", "")

    @pytest.mark.parametrize("left", [0, 50, 400, 0.5, -1])
    def test_a_truncated_exr(self, tmp_path, left):
        path = write_picture(tmp_path / "a.exr", samples(0, F32))
        data = path.read_bytes()
        path.write_bytes(data[: int(left * len(data)) if isinstance(left, float) else left])
        assert str(path) in refusal(decode, path)

    def test_a_flipped_bit_in_a_png(self, tmp_path, capfd):
        path = write_picture(tmp_path / "a.png", samples())
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        assert "checksum" in refusal(decode, path)
        assert capfd.readouterr().err == ""

    def test_a_broken_colour_profile_is_no_matter(self, tmp_path, capfd):
        path = write_picture(tmp_path / "a.png", samples())
        data = path.read_bytes()
        header = len(PNG_START) + 25
        path.write_bytes(data[:header] + _chunk(b"iCCP", b"x\0\0" + zlib.compress(b"junk")) + data[header:])
        np.testing.assert_array_equal(decode(path), samples())
        assert capfd.readouterr().err == ""

    def test_a_whole_thumbnail_does_not_make_a_jpeg_whole(self, tmp_path, capfd):
        path = write_picture(tmp_path / "a.jpg", samples(0, U8))
        data = path.read_bytes()
        exif = b"\xff\xe1" + struct.pack(">H", len(data) + 2) + data  # a segment before the picture that holds another
        path.write_bytes(data[:2] + exif + data[2:])
        assert decode(path).shape == (24, 30, 3)
        path.write_bytes(data[:2] + exif + data[2:-600])
        assert "truncated" in refusal(decode, path)
        assert capfd.readouterr().err == ""

    def test_bytes_after_a_jpeg_are_no_matter(self, tmp_path):
        path = write_picture(tmp_path / "a.jpg", samples(0, U8))
        path.write_bytes(path.read_bytes() + bytes(100_000))
        assert decode(path).shape == (24, 30, 3)

    @pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".exr", ".npy", ".bmp"])
    def test_junk(self, tmp_path, suffix):
        (tmp_path / f"a{suffix}").write_bytes(np.random.default_rng(0).bytes(5000))
        refusal(decode, tmp_path / f"a{suffix}")

    @pytest.mark.parametrize("suffix", [".png", ".tif", ".exr", ".npy"])
    def test_missing(self, tmp_path, suffix):
        assert "is missing" in refusal(decode, tmp_path / f"a{suffix}")

    @pytest.mark.parametrize("suffix", [".png", ".tif", ".exr", ".npy"])
    def test_a_folder_of_that_name(self, tmp_path, suffix):
        (tmp_path / f"a{suffix}").mkdir()
        assert "Is a directory" in refusal(decode, tmp_path / f"a{suffix}")

    @pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may read everything")
    def test_no_permission(self, tmp_path):
        path = write_picture(tmp_path / "a.png", samples())
        path.chmod(0)
        assert "Permission denied" in refusal(decode, path)

    @pytest.mark.parametrize("name", ["a.txt", "a", "a.gif", "a.psd"])
    def test_no_picture_format(self, tmp_path, name):
        (tmp_path / name).write_bytes(b"x")
        assert "a picture is needed" in refusal(decode, tmp_path / name)


class TestNpy:
    @pytest.mark.parametrize("order", ["<", ">"])
    def test_byte_order(self, tmp_path, order):
        np.save(tmp_path / "a.npy", samples().astype(f"{order}u2"))
        np.testing.assert_array_equal(decode(tmp_path / "a.npy"), samples())

    @pytest.mark.parametrize(
        "picture",
        [
            np.zeros(5),
            np.zeros((0, 4, 3)),
            np.zeros((4, 5, 7)),
            np.zeros((2, 4, 5, 3)),
            np.zeros(()),
            np.zeros((4, 5), "i4"),
            np.zeros((4, 5), complex),
            np.zeros((4, 5), "U3"),
            np.zeros((4, 5), [("a", "f4")]),
        ],
        ids=lambda a: f"{a.shape}{a.dtype}",
    )
    def test_arrays_that_are_no_picture(self, tmp_path, picture):
        np.save(tmp_path / "a.npy", picture)
        assert "needed" in refusal(decode, tmp_path / "a.npy")

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, 1e20, -1e20])
    def test_samples_that_are_no_number(self, tmp_path, value):
        picture = samples(0, np.float64)
        picture[3, 4, 1] = value
        np.save(tmp_path / "a.npy", picture)
        assert "NaN" in refusal(decode, tmp_path / "a.npy")

    def test_an_archive_is_no_array(self, tmp_path):
        np.savez(tmp_path / "a.npz", samples())
        refusal(decode, (tmp_path / "a.npz").rename(tmp_path / "a.npy"))

    def test_a_size_no_machine_has(self, tmp_path):
        np.save(tmp_path / "a.npy", np.zeros((24, 30)))
        data = (tmp_path / "a.npy").read_bytes()
        (tmp_path / "a.npy").write_bytes(data.replace(b"(24, 30), }    ", b"(24000000000, 3"[:13] + b"),}"))
        refusal(decode, tmp_path / "a.npy")

    @pytest.mark.parametrize("wrapped", [True, False])
    def test_a_pickle_is_never_opened(self, tmp_path, wrapped):
        trace = tmp_path / "trace"
        if wrapped:
            np.save(tmp_path / "a.npy", np.array([Bomb(str(trace))], object), allow_pickle=True)
        else:
            (tmp_path / "a.npy").write_bytes(pickle.dumps(Bomb(str(trace))))
        refusal(decode, tmp_path / "a.npy")
        assert not trace.exists()
        if not wrapped:  # it does what it is said to do
            pickle.loads((tmp_path / "a.npy").read_bytes())
            assert trace.exists()


class Bomb:
    """Makes a folder when it is unpickled."""

    def __init__(self, path: str):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
