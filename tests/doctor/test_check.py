"""The doctor: what was done to a capture is found and named, and a right capture is left alone."""

import json
from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.cli import main
from photonormal.doctor import findings_of
from photonormal.doctor.coverage import coverage, polar_plot
from photonormal.doctor.frame import NormalsFrame
from photonormal.doctor.order import simple_orders
from photonormal.geometry import angle_deg, fibonacci_hemisphere, normalised, rotation_about_view
from photonormal.srgb import from_linear
from photonormal.types import Capture, Normals
from tests.calibration.chrome import dome
from tests.scenes import lambertian, write_diligent


def bumps(size: int = 72) -> Normals:
    """A convex body with bumps, of no symmetry, seen whole."""
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    z = 0.75 * np.sqrt(np.maximum(1 - (x**2 + 1.2 * y**2) / 0.86, 0.01)) + 0.05 * np.sin(7 * y)
    z += 0.12 * np.sin(4 * x + 1) * np.cos(3 * y) + 0.1 * x * y
    z_y, z_x = np.gradient(z, y[:, 0], x[0])
    mask = x**2 + 1.2 * y**2 < 0.81
    map = normalised(np.stack([-z_x, -z_y, np.ones_like(z)], axis=-1))
    return Normals(np.where(mask[..., None], map, 0).astype(np.float32), mask)


def noisy(capture: Capture, seed: int = 0, sigma: float = 0.002) -> Capture:
    rng = np.random.default_rng(seed)
    images = np.asarray(capture.images)
    return replace(capture, images=(images + sigma * rng.standard_normal(images.shape).astype(np.float32)).clip(0))


LIGHTS = dome(14, 55.0)
NAMES = tuple(f"IMG_{j + 1}.png" for j in range(len(LIGHTS)))


@pytest.fixture(scope="module")
def right() -> Capture:
    return replace(noisy(lambertian(bumps(), LIGHTS)), image_names=NAMES)


def kinds(capture: Capture) -> set[str]:
    return {f.kind for f in findings_of(capture)}


def test_a_right_capture_is_left_alone(right):
    assert findings_of(right) == []


def test_an_inverted_mask_is_told_and_nothing_else_is_judged(right):
    ground = replace(right, images=np.asarray(right.images) + 0.004, mask=~right.mask, truth=None)
    found = findings_of(ground)
    assert [f.kind for f in found] == ["mask"] and found[0].grave and "invert" in found[0].message


def test_a_dark_object_on_a_bright_ground_is_no_inverted_mask(right):
    images = np.where(right.mask[..., None], 0.05 * np.asarray(right.images), 0.5)
    assert "mask" not in kinds(replace(right, images=images.astype(np.float32)))


@pytest.mark.parametrize(("flip", "frame"), [([1, -1, 1], "directx"), ([1, 1, -1], "z-away"), ([1, -1, -1], "y-down")])
def test_a_frame_that_has_a_name_is_named(right, flip, frame):
    found = [f for f in findings_of(replace(right, lights=right.lights * flip)) if f.kind == "frame"]
    assert f"where no --frame was given, add --frame {frame}." in found[0].message


@pytest.mark.parametrize(
    ("lights", "says"),
    [
        (LIGHTS[::-1], "the reversed order fits"),
        (np.roll(LIGHTS, 1, axis=0), "the order shifted by"),
        (LIGHTS[np.random.default_rng(5).permutation(len(LIGHTS))], "lights go to other pictures fits"),
        (LIGHTS[sorted(range(len(LIGHTS)), key=lambda j: NAMES[j])], "names as text"),
        (LIGHTS[[7, *range(1, 7), 0, *range(8, len(LIGHTS))]], "IMG_1.png and IMG_8.png exchanged"),
    ],
)
def test_a_wrong_order_is_named_and_corrected(right, lights, says):
    found = [f for f in findings_of(replace(right, lights=lights)) if f.kind == "order"]
    assert len(found) == 1 and found[0].grave and says in found[0].message, found
    assert angle_deg(found[0].lights, LIGHTS).max() < 1e-3


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (np.diag([1.0, -1, 1]), "y is flipped"),
        (np.diag([-1.0, 1, 1]), "x is flipped"),
        (np.diag([-1.0, -1, 1]), "x and y are both flipped"),
        (np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]]), "x and y are exchanged;"),
        (np.diag([1.0, 1, -1]), "z of the lights is flipped"),
        (rotation_about_view(90), "turned by 90 degrees"),
    ],
)
def test_a_wrong_frame_is_named_and_corrected(right, change, says):
    found = [f for f in findings_of(replace(right, lights=LIGHTS @ change.T)) if f.kind == "frame"]
    assert len(found) == 1 and found[0].grave and says in found[0].message, found
    assert angle_deg(found[0].lights, LIGHTS).max() < 1e-3


def test_the_lights_of_another_dome_are_told_and_not_corrected(right):
    others = normalised(np.random.default_rng(6).uniform(-1, 1, (len(LIGHTS), 3)) * [1, 1, 0] + [0, 0, 1])
    (found,) = [f for f in findings_of(replace(right, lights=others)) if f.kind == "order"]
    assert found.grave and found.lights is None and "don't belong to these pictures" in found.message


def test_a_wrong_order_in_a_wrong_frame_is_corrected(right):
    (found,) = [f for f in findings_of(replace(right, lights=(LIGHTS * [1, -1, 1])[::-1])) if f.kind == "order"]
    assert "the reversed order fits, and y is flipped" in found.message
    assert angle_deg(found.lights, LIGHTS).max() < 1e-3


def test_saturation_names_the_pictures(right):
    images = np.array(right.images)
    images[3] *= 3
    found = findings_of(replace(right, images=images.clip(0, 1), saturation=np.ones((len(LIGHTS), 1))))
    assert [f.numbers["pictures"] for f in found if f.kind == "saturation"] == [["IMG_4.png"]]


def test_white_samples_are_no_other_light(right):
    images = (2.2 * np.asarray(right.images)).clip(0, 1)
    found = findings_of(replace(right, images=images, saturation=np.ones((len(LIGHTS), 1))))
    assert [f.kind for f in found] == ["saturation"] and found[0].grave


def test_a_black_ground_is_not_what_lies_in_the_dark(right):
    small = np.zeros((len(LIGHTS), 120, 120, 1), np.float32)
    small[:, 24:96, 24:96] = right.images
    assert kinds(replace(right, images=small.clip(0.0), mask=np.ones((120, 120), bool), truth=None)) == {"mask"}


@pytest.mark.parametrize("off", [[5], list(range(1, 9))])
def test_lamps_that_were_off_are_named_be_they_most_of_them(right, off):
    images = np.array(right.images)
    images[off] = 0.001
    (found,) = [f for f in findings_of(replace(right, images=images)) if f.kind == "darkness"]
    assert found.grave and found.numbers["pictures"] == [f"IMG_{j + 1}.png" for j in off]


@pytest.mark.parametrize("factor", [1.0, 1.25])
def test_a_lamp_that_fired_twice_is_told_and_which_picture_lacks_its_own(right, factor):
    images = np.array(right.images)
    images[6] = factor * noisy(lambertian(bumps(), LIGHTS[2:]), seed=3).images[0]
    (found,) = findings_of(replace(right, images=images))
    assert found.kind == "repeated" and found.grave and found.numbers["pairs"] == [["IMG_3.png", "IMG_7.png"]]
    assert "(IMG_7.png fits its own light worse)" in found.message


@pytest.mark.parametrize("factor", [1.5, 1.15, 0.85])
def test_a_light_of_another_intensity_is_named_with_its_factor(right, factor):
    images = np.array(right.images)
    images[9] *= factor
    (found,) = [f for f in findings_of(replace(right, images=images)) if f.kind == "intensities"]
    assert f"1 light is brighter or darker than given (IMG_10.png x {factor:.1f}" in found.message and not found.grave


def test_many_lights_that_are_a_little_off_are_left_to_light_between_parts(right):
    images = np.array(right.images)
    images[::3] *= 1.15
    assert "intensities" not in kinds(replace(right, images=images))
    images[::3] *= 1.2
    assert "intensities" in kinds(replace(right, images=images))


def test_a_lamp_that_was_off_while_other_light_was_on_is_grave(right):
    images = np.array(right.images)
    images[5] = 0
    images += 0.1 * images.mean(0)
    (found,) = [f for f in findings_of(replace(right, images=images)) if f.kind == "intensities"]
    assert found.grave and "IMG_6.png x 0.0" in found.message and "lamp off" in found.message


def test_ambient_light_is_measured():
    low = noisy(lambertian(bumps(), dome(14, 80.0)))  # lights that leave much in attached shadow
    assert "ambient" not in kinds(low)
    (found,) = [
        f for f in findings_of(replace(low, images=np.asarray(low.images) + np.float32(0.1))) if f.kind == "ambient"
    ]
    assert found.grave and found.numbers["ambient_level"] == pytest.approx(0.1 / 0.7, rel=0.15)


def test_a_moved_camera_is_found_with_its_shift(right):
    images = np.array(right.images)
    images[2] = np.roll(images[2], (3, -4), axis=(0, 1))
    (found,) = [f for f in findings_of(replace(right, images=images)) if f.kind == "motion"]
    shifts = found.numbers["shifts_px"]
    assert list(shifts) == ["IMG_3.png"] and np.abs(np.array(shifts["IMG_3.png"]) - [-4, 3]).max() < 1


def written(tmp_path, capture, values) -> Capture:
    """The capture with its pictures as files of other values."""
    import cv2

    write_diligent(tmp_path / "object", capture)
    for j, name in enumerate(sorted(p.name for p in (tmp_path / "object").glob("0*.png"))):
        picture = values(np.clip(np.asarray(capture.images[j])[..., 0], 0, 1))
        cv2.imencode(".png", np.repeat(picture[..., None], 3, axis=-1))[1].tofile(tmp_path / "object" / name)
    return pn.load(tmp_path / "object")


def test_dim_eight_bit_pictures_are_told(right, tmp_path):
    found = [
        f for f in findings_of(written(tmp_path, right, lambda x: np.rint(12 * x).astype(np.uint8))) if f.kind == "bits"
    ]
    assert len(found) == 1 and "below level" in found[0].message and "16-bit" in found[0].message


@pytest.mark.parametrize(("brightest", "dim"), [(0.12, False), (0.01, True)])
def test_how_dim_encoded_pictures_are_is_told_by_the_levels_in_their_files(right, tmp_path, brightest, dim):
    """sRGB keeps more levels for what is dark: a median of 9 of 255 in linear light is one of 53 in the files."""
    encoded = written(tmp_path, right, lambda x: np.rint(255 * from_linear(brightest * x)).astype(np.uint8))
    linearised = pn.load(tmp_path / "object", srgb=True)
    told = [f for f in findings_of(linearised) if f.kind == "bits" and f.grave]
    assert bool(told) == dim
    level = np.median(np.median(np.asarray(encoded.images)[:, encoded.mask].mean(-1), axis=1)) * 255
    assert all(f"below level {level:.0f} of" in f.message for f in told)


def test_sixteen_bit_files_of_eight_bits_are_told(right, tmp_path):
    capture = written(tmp_path, right, lambda x: np.rint(9 * x).astype(np.uint16) * np.uint16(257))
    assert ["16-bit files hold 8-bit samples" in f.message for f in findings_of(capture) if f.kind == "bits"] == [True]


def test_srgb_pictures_are_told_and_linear_ones_are_not(right, tmp_path):
    def encoded(x):
        return np.rint(255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)).astype(np.uint8)

    assert "encoding" in kinds(written(tmp_path / "a", right, encoded))
    assert "encoding" not in kinds(written(tmp_path / "b", right, lambda x: np.rint(255 * x).astype(np.uint8)))


def test_without_a_mask_what_stands_out_of_its_ground_is_judged_but_no_patch_of_it(right):
    """What the frame cuts off more than it fills the frame is painted brighter, or shines."""
    everything = np.ones(right.mask.shape, bool)
    (found,) = findings_of(replace(right, mask=everything))
    assert found.kind == "mask" and not found.grave and "photonormal mask" in found.message
    corner = np.zeros_like(np.asarray(right.images))
    corner[:, 45:, 45:] = np.asarray(right.images)[:, 20:47, 20:47]
    assert "mask" not in kinds(replace(right, images=corner, mask=everything))


@pytest.mark.parametrize(
    ("lights", "says"),
    [
        (fibonacci_hemisphere(4), "4 lights leave no sample to spare"),
        (dome(12, 20.0), "within 20 degrees of the camera's axis"),
        (normalised(np.abs(dome(12)) * [1, 1, 1]), "no light comes from the lower left"),
        (dome(12) * [1, 0.03, 1], "lie about in one line, so that slopes across it, to the top and the bottom"),
        (dome(12) * [1, 1, -1], "12 lights lie behind the object"),
    ],
)
def test_coverage(lights, says):
    assert any(says in f.message for f in coverage(normalised(lights))), coverage(lights)


def test_even_lights_cover():
    assert coverage(dome(12)) == []


def test_the_polar_plot_shows_up_on_top():
    picture = polar_plot(np.array([[0, 0.8, 0.6], [0, 0, 1.0], [0.6, 0, 0.8]]))
    blue = np.argwhere((picture == [20, 110, 200]).all(-1))
    assert blue[:, 0].min() < picture.shape[0] * 0.3 and blue[:, 0].max() < picture.shape[0] * 0.52


def test_every_frame_is_a_turn_or_a_mirroring():
    for frame in (NormalsFrame(False, 90), NormalsFrame(True, 0), NormalsFrame(True, 90), NormalsFrame(False, 180)):
        M = frame.matrix()
        assert np.allclose(M @ M.T, np.eye(3)) and np.linalg.det(M) == pytest.approx(-1 if frame.mirrored else 1)


def test_simple_orders_are_orders():
    for order, _ in simple_orders(NAMES):
        assert sorted(order) == list(range(len(NAMES)))


def test_measure_prints_the_grave_ones(right, tmp_path, capsys):
    write_diligent(tmp_path / "flipped", replace(right, lights=LIGHTS * [1, -1, 1]))
    write_diligent(tmp_path / "reversed", replace(right, lights=LIGHTS[::-1]))
    main(["measure", str(tmp_path / "flipped"), "--out", str(tmp_path / "a"), "--no-mesh"])
    assert "y is flipped" in capsys.readouterr().err
    main(["measure", str(tmp_path / "reversed"), "--out", str(tmp_path / "b"), "--no-mesh"])
    assert "the reversed order fits" in capsys.readouterr().err


def test_the_command_writes_a_report_a_plot_and_corrected_lights(right, tmp_path, capsys):
    write_diligent(tmp_path / "object", replace(right, lights=LIGHTS[::-1]))
    assert main(["check", str(tmp_path / "object"), "--out", str(tmp_path / "result")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("grave: order: ") and "corrected.lp" in out
    assert json.loads((tmp_path / "result" / "report.json").read_text())["findings"][0]["kind"] == "order"
    fixed = pn.load(tmp_path / "object", lights=tmp_path / "result" / "corrected.lp").lights
    assert angle_deg(fixed, LIGHTS).max() < 1e-3


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("name", ["ball", "cat", "reading"])
def test_real_captures_given_wrong_lights(data, name):
    capture = pn.load(data / "diligent" / "pmsData" / f"{name}PNG")
    L = capture.lights
    assert not [f for f in findings_of(capture) if f.grave]
    n = len(L)
    for lights in (L[np.random.default_rng(1).permutation(n)], L * [1, -1, 1]):
        fixed = [f.lights for f in findings_of(replace(capture, lights=lights)) if f.kind in ("order", "frame")]
        assert len(fixed) == 1 and np.quantile(angle_deg(fixed[0], L), 0.9) < 3


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0])
def test_pictures_that_show_nothing_are_judged_without_an_error(right, level):
    """All dark, all white, or below zero; also where a single lamp was lit."""
    images = np.full((len(LIGHTS), 48, 48, 1), level, np.float32)
    findings_of(Capture(images, np.ones((48, 48), bool), LIGHTS))
    images[1:] = 0
    findings_of(Capture(images, np.ones((48, 48), bool), LIGHTS))
