"""A plain folder of photographs with a file of lights."""

import numpy as np
import pytest
from scipy.io import savemat

from photonormal import load
from tests.capture.files import LIGHTS, MASK, box, refusal, samples, write_folder, write_picture


@pytest.mark.parametrize("suffix", [".png", ".tif", ".npy", ".exr"])
@pytest.mark.parametrize("channels", [1, 3])
def test_formats(tmp_path, suffix, channels):
    dtype = np.float32 if suffix == ".exr" else np.uint16
    capture = load(write_folder(tmp_path, suffix=suffix, dtype=dtype, channels=channels))
    scale = 1 if suffix == ".exr" else 65535
    for j in range(4):
        np.testing.assert_allclose(capture.images[j], box(samples(j, dtype, channels) / scale), rtol=1e-6)
    np.testing.assert_allclose(capture.known_lights(), LIGHTS)
    np.testing.assert_array_equal(capture.mask, MASK)


def test_a_path_with_spaces_and_other_letters(tmp_path):
    folder = write_folder(tmp_path / "mein Gefäß 壺 #1")
    for j in range(4):
        (folder / f"{j + 1}.png").rename(folder / f"Größe 壺 {j + 1}.png")
    capture = load(str(folder))
    assert capture.name == "mein Gefäß 壺 #1" and capture.image_names[3] == "Größe 壺 4.png"
    np.testing.assert_allclose(capture.images[3], box(samples(3) / 65535), rtol=1e-6)


def test_a_relative_path_and_a_link(tmp_path, monkeypatch):
    write_folder(tmp_path / "owl")
    (tmp_path / "link").symlink_to(tmp_path / "owl")
    monkeypatch.chdir(tmp_path / "owl")
    assert load(".").name == "owl"
    assert load("../link").images.shape == (4, 24, 30, 3)


def test_three_rows_of_lights(tmp_path):
    np.savetxt(write_folder(tmp_path) / "light_directions.txt", 7 * LIGHTS.T)
    np.testing.assert_allclose(load(tmp_path).known_lights(), LIGHTS)


def test_intensities_divide(tmp_path):
    np.savetxt(write_folder(tmp_path) / "light_intensities.txt", [[2, 4, 8]] * 4)
    np.testing.assert_allclose(load(tmp_path).images[1], box(samples(1) / 65535 / [2, 4, 8]), rtol=1e-6)


def test_filenames_order_the_pictures(tmp_path):
    (write_folder(tmp_path) / "filenames.txt").write_text("\ufeff3.png\r\n1.png\r\n4.png\r\n2.png\r\n\r\n", "utf-8")
    assert load(tmp_path).image_names == ("3.png", "1.png", "4.png", "2.png")


def test_true_normals(tmp_path):
    map = np.zeros((24, 30, 3))
    map[MASK] = [0.6, 0, 0.8]
    savemat(write_folder(tmp_path) / "Normal_gt.mat", {"Normal_gt": map})
    truth = load(tmp_path).truth
    assert truth is not None
    np.testing.assert_array_equal(truth.mask, MASK)
    np.testing.assert_allclose(truth.map, map, rtol=1e-6)


def test_encoded_photographs(tmp_path):
    """A grey card of half the radiance is stored as 188 of 255."""
    write_folder(tmp_path)
    for j in range(4):
        write_picture(tmp_path / f"{j + 1}.png", np.full((24, 30, 3), 188, np.uint8))
    assert load(tmp_path).images[0][MASK] == pytest.approx(188 / 255)
    assert load(tmp_path, srgb=True).images[0][MASK] == pytest.approx(0.5, abs=0.005)


class TestCsv:
    rows = ("0,0,1", "0.6,0,0.8", "0,0.6,0.8", "-0.48,0.36,0.8")

    @pytest.mark.parametrize(
        "text",
        [
            "\n".join(rows),
            "x,y,z\n" + "\n".join(rows),
            "\ufeffx, y, z\r\n" + "\r\n".join(rows) + "\r\n\r\n",
            "x;y;z\n" + "\n".join(rows).replace(",", ";").replace(".", ","),
            "\n".join(rows).replace(",", "\t"),
            "\n".join(rows).replace(",", "   "),
            "light_x,light_y,light_z\n" + "\n".join(f'"{r}"'.replace(",", '","') for r in rows),
        ],
    )
    def test_without_names(self, tmp_path, text):
        (write_folder(tmp_path) / "light_directions.txt").unlink()
        (tmp_path / "lights.csv").write_text(text, "utf-8")
        np.testing.assert_allclose(load(tmp_path).known_lights(), LIGHTS)

    def test_names_choose_and_order_the_pictures(self, tmp_path):
        (write_folder(tmp_path) / "light_directions.txt").unlink()
        write_picture(tmp_path / "ambient light.png", samples(9))
        text = "image,x,y,z\n" + "\n".join(f'"{j + 1}.png",{self.rows[j]}' for j in (3, 0, 1, 2))
        (tmp_path / "lights.csv").write_text(text)
        capture = load(tmp_path)
        assert capture.image_names == ("4.png", "1.png", "2.png", "3.png")
        np.testing.assert_allclose(capture.known_lights(), LIGHTS[[3, 0, 1, 2]])

    @pytest.mark.parametrize("line", ["1,2", "a,b,c", "a,1,2", "1,2,3,4,5", "5.png,0,0,1", "", "\1\2"], ids=repr)
    def test_a_line_unlike_the_others(self, tmp_path, line):
        (write_folder(tmp_path) / "light_directions.txt").unlink()
        (tmp_path / "lights.csv").write_text("\n".join([*self.rows[:3], line]))
        message = refusal(load, tmp_path)
        assert ("line 4 of" in message) == bool(line)
        assert bool(line) or "4 pictures but 3 light directions" in message


def test_no_lights(tmp_path):
    (write_folder(tmp_path) / "light_directions.txt").unlink()
    message = refusal(load, tmp_path)
    assert all(way in message for way in ("--lights", "photonormal calibrate", "--ring", "--lights unknown"))


def test_no_pictures(tmp_path):
    assert "holds no pictures" in refusal(load, tmp_path)
    np.savetxt(tmp_path / "light_directions.txt", LIGHTS)
    assert "holds no pictures" in refusal(load, tmp_path)
    assert "holds no pictures" in refusal(load, tmp_path, lights=tmp_path / "light_directions.txt")
