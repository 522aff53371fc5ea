"""Option values that make no sense are refused before any work, in one line."""

import pytest

from photonormal.cli import main
from photonormal.methods import configure, parse
from photonormal.types import InputError

SENSELESS = {  # command -> what is added to it
    "train cpu --out OUT": (
        *("--steps -1", "--steps 0", "--minutes nan", "--minutes -1", "--minutes inf", "--seed -1", "--device mps"),
    ),
    "calibrate IN --out OUT/l.lp": (
        *("--count 0", "--circle 10,20,inf", "--circle 10,20,-3", "--circle nan,20,3", "--focal-px 0"),
        *("--radius-mm nan",),
    ),
    "measure demo --out OUT": ("--device mps", "--mm-per-px inf", "--focal-px -5"),
    "measure demo --out OUT --method": (
        *("trimmed:lowest=nan", "trimmed:highest=0.1", "l1:steps=0", "ransac:triplets=-1", "median:seed=-1"),
        *("normalnet:rotations=3", "normalnet:passes=0", "bipolynomial:degree=1000"),
    ),
    "bench diligent IN --out OUT": ("--jobs 0", "--draws -1", "--device gpu"),
    "render demo --out OUT": ("--count 0", "--seed -1", "--device mps"),
    "figure errors IN": ("--limit nan",),
}


@pytest.mark.parametrize("command", [f"{c} {wrong}" for c, more in SENSELESS.items() for wrong in more])
def test_it_is_one_line_and_nothing_is_written(command, tmp_path, capsys):
    (tmp_path / "in").mkdir()
    words = command.replace("IN", str(tmp_path / "in")).replace("OUT", str(tmp_path / "out"))
    assert main(words.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1
    assert " came but " in captured.err or "is empty" in captured.err
    assert [p.name for p in tmp_path.rglob("*")] == ["in"]


@pytest.mark.parametrize("text", ["trimmed:lowest=0:highest=1", "normalnet:rotations=4:passes=1", "bivariate:rounds=0"])
def test_what_makes_sense_is_taken(text):
    name, options = parse(text)
    assert {k: getattr(configure(name, **options), k) for k in options} == options


def test_an_error_names_the_option_and_what_is_needed():
    with pytest.raises(InputError, match=r"^trimmed with lowest nan came but a number from 0 to 1 is needed\.$"):
        configure("trimmed", lowest=float("nan"))
