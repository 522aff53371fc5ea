"""The layouts of the Blobby, CyclesPS and Light Stage sets."""

import numpy as np
import pytest

from photonormal import load
from photonormal.capture.blobby import listed_samples as blobby_samples
from tests.capture.files import LIGHTS, MASK, box, refusal, samples, write_picture

TRUTH = np.zeros((24, 30, 3))
TRUTH[MASK] = [0.6, 0, 0.8]


def check(capture, tolerance: float, mask=MASK) -> None:
    """Lights, mask and truth are those that were written."""
    np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-6)
    np.testing.assert_array_equal(capture.mask, mask)
    assert capture.truth is not None
    np.testing.assert_array_equal(capture.truth.mask, MASK)
    np.testing.assert_allclose(capture.truth.map, TRUTH, atol=tolerance)


class TestBlobby:
    @pytest.fixture
    def sample(self, tmp_path):
        shape, material = "blob01_s-0.06_x-000_y-000", "two-layer-gold"
        folder = tmp_path / "set" / "Images" / shape / material
        lines = []
        for j, (x, y, z) in enumerate(LIGHTS):
            write_picture(folder / f"{x:.2f}_{y:.2f}_{z:.2f}.png", samples(j, np.uint8))
            lines.append(f"{x:.2f}_{y:.2f}_{z:.2f}.png {x} {y} {z}")
        (folder / f"{shape}_{material}.txt").write_text("\n".join(lines))
        encoded = np.where(MASK[..., None], np.rint((TRUTH + 1) / 2 * 255), 127).astype(np.uint8)
        write_picture(folder.parent / f"{shape}_normal.png", encoded)
        (tmp_path / "set" / "train_mtrl.txt").write_text(f"{shape}/{material}\n")
        return folder

    @pytest.mark.parametrize("format", ["auto", "blobby"])
    def test_a_sample(self, sample, format):
        capture = load(sample, format=format)
        assert capture.name == "blob01_s-0.06_x-000_y-000/two-layer-gold"
        check(capture, tolerance=0.005)
        for j in range(4):
            np.testing.assert_allclose(capture.images[j], box(samples(j, np.uint8) / 255), rtol=1e-6)

    def test_from_within(self, sample, monkeypatch):
        monkeypatch.chdir(sample)
        check(load("."), tolerance=0.005)

    def test_the_list_of_a_set(self, sample):
        root = sample.parents[2]
        assert blobby_samples(root) == blobby_samples(root / "train_mtrl.txt") == [sample]
        assert "train_mtrl.txt" in refusal(blobby_samples, sample)

    def test_parts_are_missing(self, sample):
        (sample.parent / "blob01_s-0.06_x-000_y-000_normal.png").unlink()
        assert "is missing" in refusal(load, sample, format="blobby")

    def test_a_broken_list(self, sample):
        (sample / f"{sample.parent.name}_{sample.name}.txt").write_text("a.png 0 0 1\nb.png 0 1")
        assert "line 2" in refusal(load, sample)


class TestCyclesPS:
    @pytest.fixture
    def folder(self, tmp_path):
        folder = tmp_path / "sphere.obj"
        write_picture(folder / "gt_normal.tif", np.rint((TRUTH + 1) / 2 * 65535).astype(np.uint16))
        write_picture(folder / "inboundary.png", MASK.astype(np.uint8) * 255)
        write_picture(folder / "onboundary.png", MASK.astype(np.uint8) * 255)
        np.savetxt(folder / "light.txt", LIGHTS)
        return folder

    def rendering(self, folder, kind, first=0):
        for j in range(4):
            write_picture(folder / kind / f"{j:05d}.tif", samples(first + j))

    def test_an_object_with_one_rendering(self, folder):
        self.rendering(folder, "images_diffuse")
        for path in (folder, folder / "images_diffuse"):
            capture = load(path)
            assert capture.name == "sphere diffuse" and capture.image_names[2] == "00002.tif"
            check(capture, tolerance=3e-5)
            np.testing.assert_allclose(capture.images[2], box(samples(2) / 65535), rtol=1e-6)

    def test_of_several_renderings_one_is_chosen(self, folder, monkeypatch):
        self.rendering(folder, "images_diffuse")
        self.rendering(folder, "images_metallic", first=4)
        message = refusal(load, folder)
        assert "2 renderings" in message and str(folder / "images_metallic") in message
        monkeypatch.chdir(folder / "images_metallic")
        np.testing.assert_allclose(load(".").images[0], box(samples(4) / 65535), rtol=1e-6)

    def test_direct_and_indirect_light_are_added(self, folder):
        for j in range(4):
            write_picture(folder / f"{j:05d}_direct.tif", samples(j))
            write_picture(folder / f"{j:05d}_indirect.tif", samples(j + 4) // 7)
        capture = load(folder)
        assert capture.name == "sphere" and capture.images.shape[0] == 4
        check(capture, tolerance=3e-5)
        exact = (samples(1).astype(float) + samples(5) // 7) / 65535
        np.testing.assert_allclose(capture.images[1], box(exact), rtol=1e-6)
        (folder / "00003_indirect.tif").unlink()
        assert "00003_indirect.tif is missing" in refusal(load, folder)


class TestLightStage:
    BACK = np.array([0.0, 0.6, -0.8])

    @pytest.fixture
    def folder(self, tmp_path):
        """Five lights, the second from behind the object; the files hold the way that light travels."""
        lights = np.insert(LIGHTS, 1, self.BACK, axis=0)
        for j in range(5):
            write_picture(tmp_path / "helmet" / f"helmet_{j + 1:04d}.png", samples(j, np.uint8))
        write_picture(tmp_path / "helmet" / "helmet_matte.png", np.where(MASK, 0, 255).astype(np.uint8))
        rows = [" ".join(map(str, [j, *-l])) for j, l in enumerate(lights)]
        (tmp_path / "light_directions.txt").write_text("\n".join(rows))
        (tmp_path / "light_intensities.txt").write_text("\n".join(f"{j} 1.0 2.0 {j + 1}" for j in range(5)))
        return tmp_path / "helmet"

    @pytest.mark.parametrize("format", ["auto", "lightstage"])
    def test_lights_in_front_are_used(self, folder, format):
        capture = load(folder, format=format)
        np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-9)
        np.testing.assert_array_equal(capture.mask, MASK)
        assert capture.image_names[:2] == ("helmet_0001.png", "helmet_0003.png")
        np.testing.assert_allclose(capture.images[1], box(samples(2, np.uint8) / 255 / [1, 2, 3]), rtol=1e-6)

    def test_counts_differ(self, folder):
        (folder / "helmet_0005.png").unlink()
        assert "4 pictures for 5 light directions and 5 intensities" in refusal(load, folder)

    def test_no_intensity(self, folder):
        (folder.parent / "light_intensities.txt").write_text("\n".join("0 1 1 0" for _ in range(5)))
        assert "above 0" in refusal(load, folder)

    def test_two_mattes(self, folder):
        write_picture(folder / "other_matte.png", MASK.astype(np.uint8))
        assert "2 mattes" in refusal(load, folder)
