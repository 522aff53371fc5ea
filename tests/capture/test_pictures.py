"""Which files of a folder are photographs, which are used, and what is said of the others."""

import os

import numpy as np
import pytest
import tifffile

from photonormal import load
from photonormal.capture.pictures import evenly, find_mask, find_pictures, natural, parse_images
from tests.capture.files import LIGHTS, MASK, refusal, samples, write_folder, write_picture


class TestSubset:
    @pytest.mark.parametrize(
        ("text", "chosen"),
        [("", [0, 1, 2, 3, 4]), ("  ", [0, 1, 2, 3, 4]), ("2", [1]), ("1-3", [0, 1, 2]), (" 5 , 1 - 2", [4, 0, 1])],
    )
    def test_numbers_and_ranges(self, text, chosen):
        assert parse_images(text, 5) == chosen

    @pytest.mark.parametrize(
        "text",
        "0|6|3-1|1-6|-1|1-|a|1,,2|1,|1;2|1.5|1,1|1-3,2|1-999999999|\n1\n2|٣|1--2|1-2-3|,".split("|"),
    )
    def test_anything_else_is_refused(self, text):
        assert "--images" in refusal(parse_images, text, 5)

    def test_a_number_too_long_for_python(self):
        assert len(refusal(parse_images, "9" * 5000, 5)) < 200

    def test_lights_and_names_follow(self, tmp_path):
        capture = load(write_folder(tmp_path), images="4,1-2")
        assert capture.image_names == ("4.png", "1.png", "2.png")
        np.testing.assert_allclose(capture.known_lights(), LIGHTS[[3, 0, 1]])
        np.testing.assert_allclose(capture.images[0][MASK], (samples(3) / 65535)[MASK], rtol=1e-6)

    def test_a_useless_light_can_be_left_out(self, tmp_path):
        write_folder(tmp_path)
        np.savetxt(tmp_path / "light_directions.txt", np.concatenate([LIGHTS[:3], [[0, 0, 0]]]))
        assert "the light of 4.png is [0.0, 0.0, 0.0]" in refusal(load, tmp_path)
        assert load(tmp_path, images="1-3").images.shape[0] == 3

    def test_an_unreadable_picture_can_be_left_out(self, tmp_path):
        (write_folder(tmp_path) / "1.png").write_bytes(b"")
        refusal(load, tmp_path)
        load(tmp_path, images="2-4").map_images(lambda j, image: None)


class TestFolder:
    def test_image_10_comes_after_image_9(self, tmp_path):
        order = ["1.png", "a.png", "B9.png", "b10.png", "img1a.png", "img1b.png", "img02.png", "img2.png", "img²1.png"]
        for name in order:
            (tmp_path / name).touch()
        assert sorted(order[::-1], key=natural) == sorted(order, key=natural) == order
        assert [p.name for p in find_pictures(tmp_path)] == order

    def test_what_is_no_photograph(self, tmp_path):
        for name in (
            "1.png",
            "2.jpg",
            "normal.png",
            "Normal_gt.png",
            "x_mask.png",
            ".hidden.png",
            "._mask.png",
            "a.txt",
        ):
            (tmp_path / name).touch()
        for name in ("3.png", "mask.png"):
            (tmp_path / name).mkdir()
        assert [p.name for p in find_pictures(tmp_path)] == ["1.png", "2.jpg"]
        mask = find_mask(tmp_path)
        assert mask is not None and mask.name == "x_mask.png"

    def test_two_masks(self, tmp_path):
        for name in ("mask.png", "a.mask.tif"):
            (tmp_path / name).touch()
        assert "choose one with --mask" in refusal(find_mask, tmp_path)


class TestOtherPictures:
    """Pictures beside the photographs that are none under one light."""

    @pytest.mark.parametrize("name", ["0 dark.png", "a.png", "flat field.tif"])
    @pytest.mark.parametrize("option", ["dark", "flat", "mask"])
    def test_what_an_option_names_is_no_photograph(self, tmp_path, option, name):
        (write_folder(tmp_path) / "mask.png").unlink()
        file = write_picture(tmp_path / name, np.full((24, 30, 3), 20000, np.uint16))
        assert load(tmp_path, **{option: file}).image_names == ("1.png", "2.png", "3.png", "4.png")

    def test_images_are_chosen_before_lights_are_counted(self, tmp_path):
        write_picture(write_folder(tmp_path) / "0 all lights.png", samples(7))
        message = refusal(load, tmp_path)
        assert "5 pictures but 4 light directions" in message and "0 all lights.png is named unlike" in message
        capture = load(tmp_path, images="2-5")
        assert capture.image_names == ("1.png", "2.png", "3.png", "4.png")
        np.testing.assert_allclose(capture.known_lights(), LIGHTS)
        np.savetxt(tmp_path / "light_intensities.txt", [1, 2, 4, 8])
        np.testing.assert_allclose(
            load(tmp_path, images="2-5").images[3][MASK], samples(3)[MASK] / 65535 / 8, rtol=1e-5
        )

    def test_pictures_that_are_alike_are_told_by_the_first_and_last(self, tmp_path):
        write_picture(write_folder(tmp_path) / "5.png", samples(7))
        assert "they are 1.png to 5.png" in refusal(load, tmp_path)

    @pytest.mark.parametrize("name", ["{}.png", "IMG_{:04d}.png", "2024-05 {:02d} b.png"])
    def test_a_picture_that_is_missing_between_others_is_named(self, tmp_path, name):
        for j in (7, 8, 10, 11):
            write_picture(tmp_path / name.format(j), samples(j))
        np.savetxt(tmp_path / "light_directions.txt", np.concatenate([LIGHTS, LIGHTS[:1]]))
        message = refusal(load, tmp_path)
        assert f"between {name.format(7)} and {name.format(11)} {name.format(9)} is missing: restore it" in message
        assert f"{name.format(9)} is missing" in refusal(load, tmp_path, ring=5, elevation=45)
        assert "--start came without --ring" in refusal(load, tmp_path, start=45.0)
        os.rename(tmp_path / name.format(11), tmp_path / name.format(9))
        assert f"they are {name.format(7)} to {name.format(10)}; pictures are missing" in refusal(load, tmp_path)

    def test_pictures_of_kinds_that_are_not_read_are_named_where_some_are_missing(self, tmp_path):
        write_folder(tmp_path)
        os.rename(tmp_path / "2.png", tmp_path / "2.HEIC")
        (tmp_path / "1.heic").touch()  # another file of a shot that is there
        message = refusal(load, tmp_path)
        assert "3 pictures but 4 light directions" in message and "; 2.HEIC beside them can't be read" in message

    @pytest.mark.parametrize("suffix", [".jfif", ".JPE"])
    def test_jpeg_files_have_other_suffixes_too(self, tmp_path, suffix):
        for j in range(4):
            os.rename(write_picture(tmp_path / f"{j}.jpg", samples(j, np.uint8)), tmp_path / f"{j}{suffix}")
        np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
        assert load(tmp_path).images[3].shape == (24, 30, 3)

    def test_results_and_thumbnails_are_none(self, tmp_path):
        write_folder(tmp_path)
        for name in (
            *("normals.png", "albedo.png", "expected-error.png", "error.png", "preview.png", "lights.png"),
            *("1_thumb.jpg", "thumbnail.jpg", "lights_spheres.png", "normal_map.png", "lights.npy"),
        ):
            (tmp_path / name).touch()
        assert load(tmp_path, lights=tmp_path / "light_directions.txt").images.shape[0] == 4


class TestTwoKinds:
    def test_raw_and_jpeg_of_one_shot(self, tmp_path):
        write_folder(tmp_path, suffix=".jpg", dtype=np.uint8)
        for j in range(1, 5):
            (tmp_path / f"{j}.CR2").touch()
        message = refusal(load, tmp_path)
        assert "4 pictures twice, such as 1.CR2 and 1.jpg" in message or "such as 1.jpg and 1.CR2" in message
        assert "--prefer raw or --prefer jpeg" in message
        assert load(tmp_path, prefer="jpeg").image_names == ("1.jpg", "2.jpg", "3.jpg", "4.jpg")
        assert [p.name for p in find_pictures(tmp_path, prefer="raw")] == ["1.CR2", "2.CR2", "3.CR2", "4.CR2"]
        assert "twice" in refusal(load, tmp_path, prefer="tiff")
        assert "--prefer" in refusal(load, tmp_path, prefer="heic")

    def test_a_kind_that_some_lack(self, tmp_path):
        for name in ("1.png", "1.jpg", "2.png"):
            (tmp_path / name).touch()
        assert [p.name for p in find_pictures(tmp_path, prefer="jpeg")] == ["1.jpg", "2.png"]


class TestStacks:
    @pytest.mark.parametrize("options", [{"imagej": True}, {"ome": True}, {"compression": "zlib"}], ids=str)
    def test_pages_are_pictures(self, tmp_path, options):
        stack = np.stack([samples(j)[..., 0] for j in range(4)])
        tifffile.imwrite(tmp_path / "owl.tif", stack, photometric="minisblack", **options)
        np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
        capture = load(tmp_path)
        assert capture.image_names == ("owl.tif[1]", "owl.tif[2]", "owl.tif[3]", "owl.tif[4]")
        for j in range(4):
            np.testing.assert_allclose(capture.images[j][..., 0], stack[j] / 65535, rtol=1e-6)
        assert load(tmp_path, images="2-4").image_names == ("owl.tif[2]", "owl.tif[3]", "owl.tif[4]")

    def test_pages_of_colour_beside_a_mask(self, tmp_path):
        write_folder(tmp_path)
        for j in range(1, 5):
            (tmp_path / f"{j}.png").unlink()
        tifffile.imwrite(tmp_path / "owl.tif", np.stack([samples(j) for j in range(4)]), photometric="rgb")
        capture = load(tmp_path)
        np.testing.assert_allclose(capture.images[2][MASK], samples(2)[MASK] / 65535, rtol=1e-6)

    def test_more_pages_than_lights(self, tmp_path):
        tifffile.imwrite(tmp_path / "owl.tif", np.zeros((5, 24, 30), np.uint16), photometric="minisblack")
        np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
        assert "owl.tif[1] to owl.tif[5], pages of owl.tif" in refusal(load, tmp_path)


class TestChannels:
    """A photograph under red, green and blue light at a time."""

    RGB = LIGHTS[1:]

    def test_channels_are_pictures(self, tmp_path):
        write_picture(tmp_path / "gel.png", samples(3))
        np.savetxt(tmp_path / "light_directions.txt", self.RGB)
        message = refusal(load, tmp_path)
        assert "1 pictures but 3 light directions" in message and "--rgb-lights" in message
        capture = load(tmp_path, rgb_lights=True)
        assert capture.image_names == ("gel.png[red]", "gel.png[green]", "gel.png[blue]")
        for j in range(3):
            np.testing.assert_allclose(capture.images[j], samples(3)[..., j, None] / 65535, rtol=1e-6)

    def test_dark_and_flat_have_the_same_channels(self, tmp_path):
        flat, dark = np.full((24, 30, 3), 40000, np.uint16), np.full((24, 30, 3), [100, 200, 300], np.uint16)
        flat[:, :15, 0] = 20000  # red falls off to the left
        photograph = (samples(3) // 2 + 30000).astype(np.uint16)
        write_picture(tmp_path / "gel.png", photograph)
        files = {name: write_picture(tmp_path / f"{name}.png", f) for name, f in (("flat", flat), ("dark", dark))}
        np.savetxt(tmp_path / "light_directions.txt", self.RGB)
        capture = load(tmp_path, rgb_lights=True, **files)
        seen = flat.astype(float) - dark  # a board that faces the camera, lit as the object is
        for j in range(3):
            level = seen[..., j] / np.median(seen) / self.RGB[j, 2]
            expected = (photograph[..., j].astype(float) - dark[..., j]) / 65535 / level
            np.testing.assert_allclose(capture.images[j][..., 0], expected, rtol=1e-5)

    def test_a_grey_photograph_has_none(self, tmp_path):
        write_picture(tmp_path / "gel.png", samples(3, channels=1))
        np.savetxt(tmp_path / "light_directions.txt", self.RGB)
        assert "leave --rgb-lights out" in refusal(load, tmp_path, rgb_lights=True)


class TestNone:
    def test_folders_that_hold_some_are_named(self, tmp_path):
        for name in ("view_01", "view_02"):
            write_folder(tmp_path / "catPNG" / name)
        message = refusal(load, tmp_path / "catPNG")
        assert "view_01, view_02" in message and "catPNG holds no pictures" in message

    def test_files_that_are_not_read_are_named(self, tmp_path):
        (tmp_path / "1.heic").touch()
        assert "1.heic; convert" in refusal(load, tmp_path)


def test_items_are_picked_evenly():
    assert evenly([], 12) == [] and evenly("abc", 12) == ["a", "b", "c"] and evenly(range(96), 3) == [0, 48, 95]
