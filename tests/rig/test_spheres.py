"""`photonormal calibrate`, as a user runs it."""

import json

import numpy as np
import pytest

from photonormal.capture.lights import read_lights
from photonormal.cli import main
from photonormal.geometry import angle_deg, normalised
from tests.calibration.chrome import CENTRE, RADIUS, dome, highlight_at, photograph, write_chrome, write_pictures


def run(capsys, *arguments) -> tuple[int, str, str]:
    code = main([str(a) for a in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture
def rig(tmp_path):
    write_chrome(tmp_path / "chrome", dome(9))
    write_pictures(tmp_path / "object", np.full((9, 30, 40), 90, np.uint8), name="DSC {:03d}.png")
    return tmp_path


def test_lights_are_right_and_named_after_the_object_s_pictures(rig, capsys):
    code, out, err = run(
        capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "new folder" / "lights.lp"
    )
    assert (code, err) == (0, "") and "(good)" in out
    listed = read_lights(rig / "new folder" / "lights.lp")
    names, L = listed.names, listed.vectors
    assert names == [f"DSC {j:03d}.png" for j in range(1, 10)]
    assert angle_deg(L, dome(9)).max() < 1
    assert np.allclose(read_lights(rig / "new folder" / "light_directions.txt").vectors, L)
    report = json.loads((rig / "new folder" / "lights.json").read_text())
    assert report["spheres"][0]["circle"]["residual_px"] < 1 and len(report["lights"]) == 9
    assert (rig / "new folder" / "lights_spheres.png").stat().st_size > 10000


@pytest.mark.parametrize("how", ["mask", "circle"])
def test_a_mask_or_a_given_circle_is_exact(rig, capsys, how):
    write_chrome(rig / "marked", dome(9), mask=how == "mask")
    given = ["--circle", f"{CENTRE[0]},{CENTRE[1]},{RADIUS}"] if how == "circle" else []
    run(capsys, "calibrate", rig / "object", "--sphere", rig / "marked", "--out", rig / "lights.lp", *given)
    assert angle_deg(read_lights(rig / "lights.lp").vectors, dome(9)).max() < 0.5


def test_a_sphere_beside_the_object_is_found_in_its_own_pictures(tmp_path, capsys):
    write_chrome(tmp_path / "scene", dome(7))
    assert run(capsys, "calibrate", tmp_path / "scene", "--out", tmp_path / "lights.lp")[0] == 0
    assert angle_deg(read_lights(tmp_path / "lights.lp").vectors, dome(7)).max() < 1


def test_a_mask_beside_the_object_is_not_the_sphere_s(tmp_path, capsys):
    write_chrome(tmp_path / "scene", dome(7), mask=True, centre=(100.0, 117.6), radius=50.0)
    place = {"centre": (230.0, 110.0), "radius": 60.0}
    write_chrome(tmp_path / "scene", dome(7), **place)  # the mask stays where the object is
    assert run(capsys, "calibrate", tmp_path / "scene", "--out", tmp_path / "lights.lp")[0] == 0
    assert angle_deg(read_lights(tmp_path / "lights.lp").vectors, dome(7)).max() < 1


def test_a_reference_picture_without_a_number_is_no_light(rig, capsys):
    import cv2

    cv2.imencode(".png", photograph([], ground=0.9))[1].tofile(rig / "chrome" / "ref.png")
    run(capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "lights.lp")
    assert angle_deg(read_lights(rig / "lights.lp").vectors, dome(9)).max() < 1


def test_two_folders_are_averaged_and_their_disagreement_reported(rig, capsys):
    other = {"centre": (170.0, 110.0), "radius": 70.0}
    write_chrome(rig / "second", dome(9), **other)
    run(capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", rig / "second", "--out", rig / "lights.lp")
    report = json.loads((rig / "lights.json").read_text())
    assert angle_deg(read_lights(rig / "lights.lp").vectors, dome(9)).max() < 0.8
    assert all(len(light["off_mean_deg"]) == 2 and max(light["off_mean_deg"]) < 1 for light in report["lights"])
    assert report["warnings"] == []


def test_spheres_that_disagree_are_told(rig, capsys):
    write_chrome(rig / "second", dome(9)[::-1], centre=(170.0, 110.0), radius=70.0)
    where = [
        "--sphere",
        rig / "chrome",
        rig / "second",
        "--circle",
        circle(*CENTRE, RADIUS),
        circle(170.0, 110.0, 70.0),
    ]
    code, _, err = run(capsys, "calibrate", rig / "object", *where, "--out", rig / "lights.lp")
    assert code == 0 and "the spheres disagree about 8 of 9 lights" in err and "in another order" in err


def circle(x: float, y: float, r: float) -> str:
    return f"{x},{y},{r}"


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--circle", "150,117,81", "50,50,20"], "2 circles came for 1 sphere; give one for each"),
        (["--count", "2", "--circle", "150,117,81"], "1 circle came for 2 spheres; give one for each"),
        (["--radius-mm", "20"], "--radius-mm 20 came for one sphere but"),
    ],
)
def test_what_would_be_left_unused_is_refused(rig, capsys, given, says):
    code, _, err = run(capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "a.lp", *given)
    assert code == 2 and says in err and not (rig / "a.lp").exists()


def test_two_spheres_in_one_frame_give_positions(tmp_path, capsys):
    """Lights half a metre away, spheres of 20 mm in radius and 100 mm apart; a pixel is 0.4 mm."""
    places, r, mm = [(70.0, 120.0), (250.0, 115.0)], 50.0, 0.4
    lights = np.array([[200.0, 100, 400], [-250, 50, 350], [50, -220, 420], [0, 260, 300]])
    pictures = []
    for j, light in enumerate(lights):
        halves = []
        for c in places:
            centre = np.array([c[0] - 159.5, 119.5 - c[1], 0]) * mm
            point = centre + np.array([0, 0, r * mm])
            for _ in range(50):  # the point that halves view and the direction to the light
                half = normalised(normalised(light - point) + np.array([0.0, 0, 1]))
                point = centre + r * mm * half
            halves.append((c[0] + r * half[0], c[1] - r * half[1], 2.5))
        a, b = (photograph([h], c, r, seed=j) for h, c in zip(halves, places, strict=True))
        pictures.append(np.hstack([a[:, :160], b[:, 160:]]))
    write_pictures(tmp_path / "scene", pictures)
    circles = [f"{x},{y},{r}" for x, y in places]
    code, *_ = run(
        capsys, "calibrate", tmp_path / "scene", "--out", tmp_path / "l.lp", "--count", 2, "--radius-mm", 20,
        "--circle", *circles,
    )  # fmt: skip
    found = read_lights(tmp_path / "light_positions.txt").vectors
    assert code == 0 and (np.linalg.norm(found - lights, axis=1) < 0.03 * np.linalg.norm(lights, axis=1)).all()


class TestRefusals:
    """One line on standard error, exit code 2, nothing written."""

    def refused(self, capsys, tmp_path, *arguments, says: str, picture: bool = False):
        before = {*tmp_path.rglob("*")}
        code, out, err = run(capsys, "calibrate", *arguments)
        assert code == 2 and out == "" and err.count("\n") == 1 and says in err, err
        drawn = {tmp_path / "l_refused.png"} if picture else set()
        assert {*tmp_path.rglob("*")} == before | drawn

    def test_no_sphere(self, rig, capsys):
        self.refused(
            capsys,
            rig,
            rig / "object",
            "--out",
            rig / "l.lp",
            says="no mirror sphere was found in object",
            picture=True,
        )

    def test_another_number_of_pictures(self, rig, capsys):
        (rig / "chrome" / "09.png").unlink()
        self.refused(capsys, rig, rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.lp", says="8 lights")

    def test_a_picture_of_the_object_that_the_sphere_lacks(self, rig, capsys):
        """Its others are called as the object's, so that the order of what is there would be another."""
        for j in range(9):
            (rig / "chrome" / f"{j + 1:02d}.png").rename(rig / "chrome" / f"DSC {j + 1:03d}.png")
        (rig / "chrome" / "DSC 004.png").rename(rig / "chrome" / "DSC 010.png")
        where = (rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.lp")
        self.refused(capsys, rig, *where, says="no picture that is called DSC 004.png")

    def test_a_file_that_exists(self, rig, capsys):
        (rig / "l.lp").write_text("mine")
        self.refused(capsys, rig, rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.lp", says="--overwrite")

    def test_another_ending(self, rig, capsys):
        self.refused(capsys, rig, rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.txt", says=".lp file")

    @pytest.mark.parametrize("circle", ["10,20", "a,b,c", "9000,10,40", "10,10,0"])
    def test_a_circle_that_is_none(self, rig, capsys, circle):
        self.refused(
            capsys, rig, rig / "object", "--sphere", rig / "chrome", "--circle", circle, "--out", rig / "l.lp",
            says="--circle", picture=circle.startswith("9000"),
        )  # fmt: skip

    def test_no_folder(self, rig, capsys):
        self.refused(capsys, rig, rig / "absent", "--out", rig / "l.lp", says="no folder")

    def test_lights_behind_the_sphere(self, rig, capsys):
        dark(rig, 3, 5, 7)
        self.refused(
            capsys, rig, rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.lp",
            "--circle", f"{CENTRE[0]},{CENTRE[1]},{RADIUS}", says="in 3 of 9 pictures", picture=True,
        )  # fmt: skip

    @pytest.mark.parametrize(("skip", "says"), [("1-9", "all 9"), ("10", "--skip '10'"), ("a", "--skip 'a'")])
    def test_pictures_that_cannot_be_skipped(self, rig, capsys, skip, says):
        self.refused(
            capsys, rig, rig / "object", "--sphere", rig / "chrome", "--out", rig / "l.lp", "--skip", skip, says=says
        )


def dark(rig, *numbers) -> None:
    """Photographs of the sphere without a lamp."""
    import cv2

    for j in numbers:
        cv2.imencode(".png", photograph([]))[1].tofile(rig / "chrome" / f"{j:02d}.png")


def test_a_lamp_that_is_off_is_left_out_and_told(rig, capsys):
    dark(rig, 5)
    code, _, err = run(capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "lights.lp")
    listed = read_lights(rig / "lights.lp")
    names, L = listed.names, listed.vectors
    assert (
        code == 0
        and "no highlight was found on the sphere in DSC 005.png of chrome" in err
        and "--dark" in err
        and "DSC 005.png" not in names
    )
    assert angle_deg(L, np.delete(dome(9), 4, axis=0)).max() < 1


def test_photographs_can_be_skipped(rig, capsys):
    dark(rig, 2, 3, 5)
    code, _, err = run(
        capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "lights.lp", "--skip", "2-3,5"
    )
    listed = read_lights(rig / "lights.lp")
    names, L = listed.names, listed.vectors
    assert (code, err) == (0, "") and [name[4:7] for name in names] == ["001", "004", "006", "007", "008", "009"]
    assert angle_deg(L, np.delete(dome(9), [1, 2, 4], axis=0)).max() < 1


def test_the_picture_of_a_refusal_goes_when_a_sphere_is_found(rig, capsys):
    assert run(capsys, "calibrate", rig / "object", "--out", rig / "lights.lp")[0] == 2
    assert (rig / "lights_refused.png").is_file()
    assert run(capsys, "calibrate", rig / "object", "--sphere", rig / "chrome", "--out", rig / "lights.lp")[0] == 0
    assert not (rig / "lights_refused.png").exists()


@pytest.mark.data
class TestRealSpheres:
    """The frog of Harvard with each of its two probes, and UW's chrome sphere."""

    def off(self, data, tmp_path, capsys, probe, *given):
        frog = data / "captures" / "harvard" / "frog"
        sphere = frog / f"LightProbe-{probe}"
        code, *_ = run(
            capsys, "calibrate", frog / "Objects", "--sphere", sphere, "--out", tmp_path / "lights.lp", *given
        )
        assert code == 0
        reference = normalised(read_lights(frog / "light_directions.txt").vectors)
        return angle_deg(read_lights(tmp_path / "lights.lp").vectors, reference).mean()

    @pytest.mark.parametrize("probe", [1, 2])
    def test_with_the_circle_of_the_set(self, data, tmp_path, capsys, probe):
        sphere = data / "captures" / "harvard" / "frog" / f"LightProbe-{probe}"
        x, y, r = np.loadtxt(sphere / "circle_data.txt")
        height = {1: 1200, 2: 1300}[probe]
        assert self.off(data, tmp_path, capsys, probe, "--circle", f"{x},{height - y},{r}") < 0.75

    @pytest.mark.parametrize("probe", [1, 2])
    def test_unaided(self, data, tmp_path, capsys, probe):
        assert self.off(data, tmp_path, capsys, probe) < 1.2

    def test_mask_and_detection_agree_on_chrome(self, data, tmp_path, capsys):
        uw = data / "captures" / "uw"
        run(capsys, "calibrate", uw / "owl", "--sphere", uw / "chrome", "--out", tmp_path / "a" / "lights.lp")
        (tmp_path / "chrome").mkdir()
        for picture in (uw / "chrome").glob("chrome.*[0-9].png"):
            (tmp_path / "chrome" / picture.name).symlink_to(picture)
        run(capsys, "calibrate", uw / "owl", "--sphere", tmp_path / "chrome", "--out", tmp_path / "b" / "lights.lp")
        a, b = (read_lights(tmp_path / k / "lights.lp").vectors for k in "ab")
        assert angle_deg(a, b).max() < 1.5 and a[:, 1].min() > 0  # all of these lights hang above the camera


def test_highlights_are_where_the_law_puts_them():
    assert highlight_at(np.array([0, 0, 1.0])) == CENTRE
