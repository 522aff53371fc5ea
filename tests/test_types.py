"""The values that pass between stages hold what they promise, or say why they can't."""

import numpy as np
import pytest

from photonormal.types import Camera, Capture, InputError, Lamps, Normals, Surface, lights_behind, unit_lights
from tests.capture.files import LIGHTS, MASK, refusal

IMAGES = np.zeros((4, 24, 30, 3), np.float32)
NAMES = [f"{j}.png" for j in range(4)]


class TestLights:
    @pytest.mark.parametrize("scale", [1, 1e-200, 1e300, 5e-324])
    def test_any_length_becomes_one(self, scale):
        lights = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 1, 0]])
        unit = unit_lights(scale * lights, NAMES)
        np.testing.assert_allclose(unit, lights / np.linalg.norm(lights, axis=1, keepdims=True), atol=1e-15)

    def test_behind_the_object_is_what_shines_away_from_the_camera(self):
        """A lamp on the horizon lights every slope that faces it, whatever side of it rounding puts it on."""
        elevation = np.radians([-30, -0.1, 0, 180, 0.1, 90])
        lights = np.stack([np.cos(elevation), np.zeros(6), np.sin(elevation)], axis=-1)
        assert lights_behind(lights).tolist() == [0, 1] == lights_behind(lights - [0, 0, 1e-12]).tolist()

    @pytest.mark.parametrize("shape", [(3, 3), (5, 3), (4, 2), (3, 4), (12,), (0, 3)])
    def test_other_shapes(self, shape):
        assert str(shape) in refusal(unit_lights, np.ones(shape), NAMES)

    @pytest.mark.parametrize("bad", [[0, 0, 0], [np.nan, 0, 1], [0, np.inf, 1], [0, 0, -np.inf]])
    def test_no_direction_is_named(self, bad):
        lights = LIGHTS.copy()
        lights[2] = bad
        assert "the light of 2.png is [" in refusal(unit_lights, lights, NAMES)

    def test_condition_number_of_lights_in_a_plane(self):
        """Lights within a cone of half angle a around the view: the condition number is sqrt(2) / tan(a)."""
        phi = np.arange(4) * np.pi / 2
        for a, usable in ((0.01, True), (0.001, False)):
            cone = np.stack([np.sin(a) * np.cos(phi), np.sin(a) * np.sin(phi), np.full(4, np.cos(a))], axis=-1)
            if usable:
                unit_lights(cone, NAMES)
            else:
                assert f"condition number {2**0.5 / np.tan(a):.3g}," in refusal(unit_lights, cone, NAMES)
        assert "condition number" in refusal(unit_lights, LIGHTS * [1, 0, 1], NAMES)

    def test_two_lights_never_span_space(self):
        assert "condition number" in refusal(unit_lights, LIGHTS[[1, 2]], NAMES[:2])


class TestCapture:
    def test_lights_are_made_unit_and_names_are_given(self):
        capture = Capture(IMAGES, MASK, 3 * LIGHTS)
        np.testing.assert_allclose(capture.known_lights(), LIGHTS)
        assert capture.image_names == ("image 1", "image 2", "image 3", "image 4")

    def test_unknown_lights(self):
        assert "no light directions" in refusal(Capture(IMAGES, MASK).known_lights)

    def test_map_images_keeps_the_order(self):
        images = np.arange(4, dtype=np.float32)[:, None, None, None] + IMAGES
        assert Capture(images, MASK).map_images(lambda j, image: (j, image.max())) == [(j, j) for j in range(4)]

    def test_map_images_passes_errors_on(self):
        def fail(j, image):
            raise InputError("no.")

        with pytest.raises(InputError, match="no"):
            Capture(IMAGES, MASK).map_images(fail)

    @pytest.mark.parametrize("images", [IMAGES[0], IMAGES[..., :2], IMAGES[0, ..., 0], IMAGES[:2], IMAGES[:0]])
    def test_other_shapes(self, images):
        refusal(Capture, images, MASK)

    @pytest.mark.parametrize("mask", [MASK[1:], MASK[None], MASK[1:].astype(np.uint8), MASK & False])
    def test_other_masks(self, mask):
        assert "mask" in refusal(Capture, IMAGES, mask)

    def test_names_of_another_count(self):
        assert "3 names came for 4 images" in refusal(Capture, IMAGES, MASK, image_names=("a", "b", "c"))

    def test_truth_of_another_size(self):
        truth = Normals(np.zeros((5, 6, 3)), np.zeros((5, 6), bool))
        assert "(5, 6, 3)" in refusal(Capture, IMAGES, MASK, truth=truth)


class TestNormals:
    def test_zero_outside_of_the_mask(self):
        normals = Normals(np.broadcast_to([0, 0, 1.0], (24, 30, 3)), MASK)
        assert normals.map.dtype == np.float32
        np.testing.assert_array_equal(normals.map.sum(-1), MASK)

    @pytest.mark.parametrize("value", [0, 0.9, 1.1, np.nan, np.inf])
    def test_other_lengths(self, value):
        map = np.zeros((24, 30, 3))
        map[MASK, 2] = 1
        map[10, 12, 2] = value
        assert "1 normals inside the mask" in refusal(Normals, map, MASK)

    @pytest.mark.parametrize("shape", [(24, 30), (24, 30, 1), (24, 29, 3)])
    def test_other_shapes(self, shape):
        assert str(shape) in refusal(Normals, np.zeros(shape), MASK)


class TestSurface:
    def test_other_shapes(self):
        assert "depth" in refusal(Surface, np.zeros((24, 29)), MASK)
        assert "camera matrix" in refusal(Surface, np.zeros((24, 30)), MASK, np.eye(4))


def test_an_input_error_is_one_line_and_a_value_error():
    error = InputError("a\nb\r\nc.")
    assert str(error) == "a b c." and isinstance(error, ValueError)


class TestLamps:
    CAMERA = Camera(2.0)
    S = np.array([[0, 0, 300], [200, 0, 200], [0, 200, 200], [-150, -150, 200]], float)
    K = np.array([[100.0, 0, 14.5], [0, 100, 9.5], [0, 0, 1]])

    def capture(self, positions_mm=S, camera: Camera | None = CAMERA) -> Capture:
        images, mask = np.ones((4, 20, 30, 1), np.float32), np.ones((20, 30), bool)
        return Capture(images, mask, lamps=Lamps(positions_mm), camera=camera, image_names=("a", "b", "c", "d"))

    def test_are_seen_from_the_object_s_middle(self):
        lights = self.S / np.linalg.norm(self.S, axis=1, keepdims=True)
        np.testing.assert_allclose(self.capture().known_lights(), lights, atol=1e-12)
        seen = self.capture(self.S - [0, 0, 200], Camera(2.0, self.K))  # the object is 200 mm in front of the camera
        np.testing.assert_allclose(seen.known_lights(), lights, atol=1e-12)

    def test_pixels_in_millimetres(self):
        X = Camera(2.0).points_mm(np.array([[1.0, np.nan, 0], [0, 0, 0]]))
        np.testing.assert_allclose(X[0], [[-2, 1, 2], [0, 1, 0], [2, 1, 0]])
        X = Camera(2.0, np.array([[10.0, 0, 1], [0, 10, 0], [0, 0, 1]])).points_mm(np.array([[1, np.nan, 1.5]] * 2))
        np.testing.assert_allclose(X[0], [[-2, 0, -20], [0, 0, -20], [3, 0, -30]])
        np.testing.assert_allclose(X[1, 1], [0, -2, -20])

    @pytest.mark.parametrize(
        ("positions_mm", "camera", "said"),
        [
            (S / 1000, CAMERA, "multiply the positions by 1000, since they look like metres"),
            (S / 10, CAMERA, "multiply the positions by 10, since they look like centimetres"),
            (S * [[0.1], [1], [1], [1]], CAMERA, "the lamp of a is 30 mm from the middle of an object"),
            (S[:3], CAMERA, "3 lamps came for 4 images"),
            (S, None, "--mm-per-px"),
            (S[:, :2], CAMERA, "(4, 2)"),
            (S + np.nan, CAMERA, "finite"),
        ],
    )
    def test_refused(self, positions_mm, camera, said):
        assert said in refusal(self.capture, positions_mm, camera)

    def test_axes_and_exponents_are_checked(self):
        assert "axes" in refusal(Lamps, self.S, axes=np.zeros((4, 3)))
        assert "mu" in refusal(Lamps, self.S, mu=-np.ones(4))
        assert "mm wide" in refusal(Camera, 0.0)
