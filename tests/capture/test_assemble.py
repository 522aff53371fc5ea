"""Subsets, sorting and the choice of what in a folder is a picture or a mask."""

import numpy as np
import pytest

from photonormal import load
from photonormal.capture.assemble import known_normals
from photonormal.capture.pictures import find_mask, find_pictures, natural, parse_images
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
        order = ["a.png", "B9.png", "b10.png", "img1a.png", "img1b.png", "img02.png", "img2.png", "img²1.png", "1.png"]
        paths = [tmp_path / name for name in order]
        assert sorted(paths[::-1], key=natural) == sorted(paths, key=natural) == paths

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


def test_normals_are_known_where_they_have_a_length():
    map = np.zeros((2, 3, 3))
    map[0, 0], map[0, 1], map[1, 1], map[1, 2] = [0, 0, 1.02], [0.6, 0, 0.8], [np.nan, 0, 1], [1e200, 0, 0]
    known = known_normals(map)
    np.testing.assert_array_equal(known.mask, [[True, True, False], [False, False, False]])
    np.testing.assert_allclose(known.map[0, 0], [0, 0, 1])


class TestOtherLightsAndMask:
    def test_lights_of_another_capture_keep_their_order(self, tmp_path):
        """Lights that a sphere gave are used for an object: other names, the same order."""
        write_folder(tmp_path / "owl")
        lines = [f"sphere {j}.png {x} {y} {z}" for j, (x, y, z) in enumerate(LIGHTS[::-1])]
        (tmp_path / "sphere.lp").write_text("\n".join(["4", *lines]))
        np.testing.assert_allclose(
            load(tmp_path / "owl", lights=tmp_path / "sphere.lp").known_lights(), LIGHTS[::-1], atol=1e-9
        )

    @pytest.mark.parametrize("suffix", [".lp", ".csv"])
    def test_lights_that_name_the_pictures_go_by_name(self, tmp_path, suffix):
        write_folder(tmp_path / "owl")
        rows = [(f"C:\\rig\\{j}.png", *LIGHTS[j - 1]) for j in (3, 1, 4, 2)]
        text = "\n".join((" " if suffix == ".lp" else ",").join(map(str, row)) for row in rows)
        (tmp_path / f"rig{suffix}").write_text("4\n" + text if suffix == ".lp" else text)
        np.testing.assert_allclose(
            load(tmp_path / "owl", lights=tmp_path / f"rig{suffix}").known_lights(), LIGHTS, atol=1e-9
        )

    def test_lights_that_name_only_some(self, tmp_path):
        write_folder(tmp_path / "owl")
        (tmp_path / "rig.csv").write_text("1.png,0,0,1\n2.png,0,1,1\n3.png,1,0,1\nx.png,1,1,1")
        assert "no light for 4.png" in refusal(load, tmp_path / "owl", lights=tmp_path / "rig.csv")

    def test_a_mask_given(self, tmp_path):
        write_folder(tmp_path / "owl")
        other = np.zeros_like(MASK)
        other[2:5, 3:9] = True
        write_picture(tmp_path / "elsewhere" / "m.png", other.astype(np.uint8))
        np.testing.assert_array_equal(load(tmp_path / "owl", mask=tmp_path / "elsewhere" / "m.png").mask, other)

    def test_no_mask_is_the_whole_frame(self, tmp_path):
        (write_folder(tmp_path) / "mask.png").unlink()
        capture = load(tmp_path)
        assert capture.mask.all()
        np.testing.assert_allclose(capture.images[2], samples(2) / 65535, rtol=1e-6)
