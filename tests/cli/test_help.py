"""What the commands print for people and for programs: help, version, JSON, the next step."""

import ast
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

import photonormal
from photonormal import cli
from photonormal.cli import COMMANDS, main
from photonormal.geometry import FRAMES
from photonormal.methods import METHODS
from photonormal.options import Frame
from photonormal.srgb import from_linear
from tests.calibration.chrome import dome, write_chrome
from tests.methods.uncalibrated.test_refine import scattered
from tests.scenes import lambertian, ring, sphere, write_diligent


def help_of(command: str, capsys) -> str:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    return capsys.readouterr().out


@pytest.mark.parametrize("command", [c.__name__.lower() for c in COMMANDS])
def test_no_help_speaks_of_none(command, capsys):
    assert "None" not in help_of(command, capsys)


@pytest.mark.parametrize("command", [c.__name__.lower() for c in COMMANDS])
def test_what_to_give_is_named_and_no_default_is_empty(command, capsys):
    said = " ".join(help_of(command, capsys).replace("│", "").split())
    assert "STR" not in said and "(default: )" not in said and "(default: '')" not in said


@pytest.mark.parametrize("file", sorted(Path(cli.__file__).parent.glob("*.py")), ids=lambda p: p.name)
def test_no_line_of_an_option_ends_within_a_sentence(file):
    """The help breaks lines where its source does, at any width."""
    texts = [
        text.value.value
        for kind in ast.walk(ast.parse(file.read_text()))
        if isinstance(kind, ast.ClassDef)
        for option, text in pairwise(kind.body)
        if isinstance(option, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    ]
    assert [text for text in texts if not all(line.endswith(".") for line in text.splitlines())] == []


def test_options_of_measure_stand_in_groups_with_their_choices(capsys):
    said = help_of("measure", capsys)
    groups = [said.index(f" {name} options ") for name in ("capture", "lights", "corrections", "method", "results")]
    assert groups == sorted(groups)
    assert " STR " not in said
    joined = "".join(said.replace("│", "").split())
    assert "{" + ",".join(METHODS) + "}" in joined and "{simchony,quadratic,bilateral}" in joined
    assert "{" + ",".join(FRAMES) + "}" in joined


def test_frames_of_options_are_those_there_are():
    assert set(Frame.__origin__.__args__) == set(FRAMES)  # type: ignore[attr-defined]


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"photonormal {photonormal.__version__}\n"


@pytest.fixture
def turned(tmp_path):
    """A capture whose lights are given with y downwards: a grave fault."""
    capture = lambertian(sphere(64), ring(10, 45) * [1, -1, 1])
    write_diligent(tmp_path / "ball", lambertian(sphere(64), ring(10, 45)))
    (tmp_path / "ball" / "light_directions.txt").write_text(
        "\n".join(" ".join(f"{v:.6f}" for v in light) for light in capture.known_lights())
    )
    return str(tmp_path / "ball")


def test_check_is_strict_when_asked_to_be(turned, capsys):
    assert main(["check", turned]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("grave: ") and lines[-1] == f"next: photonormal check {turned} --out report"
    assert main(["check", turned, "--strict", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert found[0]["grave"] and found[0]["kind"] and found[0]["message"]
    assert main(["check", "demo", "--strict"]) == 0


def test_the_next_step_keeps_how_the_photographs_are_read(turned, capsys):
    main(["check", turned, "--frame", "directx", "--images", "1-9"])
    words = f"next: photonormal measure {turned} --images 1-9 --frame directx --out result"
    assert capsys.readouterr().out.splitlines()[-1] == words


def test_the_next_step_has_the_option_that_was_asked_for(tmp_path, capsys):
    right = lambertian(sphere(64), scattered(20))
    write_diligent(tmp_path / "ball", replace(right, images=from_linear(right.images / right.images.max())))
    folder = str(tmp_path / "ball")
    main(["check", folder, "--linear"])
    said = capsys.readouterr().out
    assert "add --srgb" in said and "Mend first" not in said
    assert said.splitlines()[-1] == f"next: photonormal measure {folder} --srgb --out result"
    main(said.splitlines()[-1].replace("measure", "check").split()[2:-2])
    assert "encoding" not in capsys.readouterr().out


def test_an_inverted_mask_leads_to_a_mask_from_the_shading(tmp_path, capsys):
    write_diligent(tmp_path / "ball", lambertian(sphere(64), scattered(20)))
    path = tmp_path / "ball" / "mask.png"
    cv2.imwrite(str(path), 255 - cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    main(["check", str(tmp_path / "ball")])
    said = capsys.readouterr().out
    assert "looks inverted" in said and "Mend first" not in said
    assert said.splitlines()[-1] == f"next: photonormal mask {tmp_path / 'ball'} --out object-mask.png"


def test_jpeg_files_that_say_nothing_lead_to_srgb(tmp_path, capsys):
    scene = lambertian(sphere(64), lights := scattered(20))
    levels = np.rint(255 * from_linear(scene.images / scene.images.max())).astype(np.uint8)
    for j, level in enumerate(levels):
        cv2.imwrite(str(tmp_path / f"{j:02d}.jpg"), level, [cv2.IMWRITE_JPEG_QUALITY, 98])
    np.savetxt(tmp_path / "light_directions.txt", lights)
    main(["check", str(tmp_path)])
    assert capsys.readouterr().out.splitlines()[-1] == f"next: photonormal measure {tmp_path} --srgb --out result"


def test_lights_are_corrected_by_the_commands_that_come_next(turned, tmp_path, capsys):
    report = str(tmp_path / "report")
    main(["check", turned, "--frame", "opengl", "--out", report])
    words = f"next: photonormal measure {turned} --lights {report}/corrected.lp --out result"
    assert capsys.readouterr().out.splitlines()[-1] == words
    assert main(["check", turned, "--lights", f"{report}/corrected.lp", "--strict"]) == 0


def test_measure_prints_its_report(turned, tmp_path, capsys):
    out = tmp_path / "my result"
    assert main(["measure", turned, "--method", "woodham", "--no-mesh", "--json", "--out", str(out)]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((out / "report.json").read_text())
    assert main(["measure", turned, "--method", "woodham", "--no-mesh", "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"next: photonormal view '{out}'"


def test_calibrate_leads_to_check(tmp_path, capsys):
    write_chrome(tmp_path / "scene", dome(7), mask=True)
    folder, lights = str(tmp_path / "scene"), str(tmp_path / "l.lp")
    assert main(["calibrate", folder, "--out", lights]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"next: photonormal check {folder} --lights {lights}"
    assert main(["calibrate", folder, "--out", lights, "--overwrite", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["lights"]) == 7
    assert cli.main(["check", folder, "--lights", lights, "--json"]) == 0
