"""The last step of reading: what a user names instead of the capture's own."""

import numpy as np
import pytest

from photonormal import load
from photonormal.capture.assemble import known_normals
from tests.capture.files import LIGHTS, MASK, refusal, samples, write_folder, write_picture


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
