"""What is held at a time follows from the memory that is allowed, and changes nothing that is found."""

import numpy as np
import pytest
import torch

from photonormal import load, solve
from photonormal.cli import main
from photonormal.files import memory
from photonormal.geometry import angle_deg
from photonormal.methods import configure
from photonormal.methods.engine import plan
from photonormal.types import InputError

CPU = torch.device("cpu")
LARGE = (6000, 4000)  # pixels


@pytest.fixture
def allow(monkeypatch):
    def to(nbytes: float) -> None:
        monkeypatch.setattr(memory, "_given", int(nbytes))

    return to


@pytest.mark.parametrize("rotations", [1, 4])
def test_a_window_fits_into_its_share(allow, rotations):
    net = configure("normalnet").network()
    sides = []
    for nbytes in (5e9, 8e9, 20e9, 200e9):
        allow(nbytes)
        side = plan.side(net, 2, rotations, CPU, LARGE, 8)
        assert side % net.stride == 0 and 64 <= side <= plan.SIDE["cpu"]
        assert (rotations * plan.SEEN + 8 * plan.SAMPLE) * (side + 4 * net.reach) ** 2 <= plan.WINDOW * nbytes
        sides.append(side)
    assert sides == sorted(sides) and sides[-1] == plan.SIDE["cpu"]


def test_what_is_too_small_is_told(allow):
    net, capture = configure("normalnet").network(), load("demo")
    allow(1e8)
    with pytest.raises(InputError, match=r"a window of 64 pixels .* needs .* such as --memory"):
        plan.side(net, 2, 1, CPU, LARGE, 8)
    assert plan.side(net, 2, 1, CPU, (100, 100), 8) == plan.SIDE["cpu"]  # what is small is seen as a whole
    allow(1e4)
    with pytest.raises(InputError, match=r"a row of 160 pixels .* needs .* such as --memory"):
        plan.pixels(capture)


def test_a_graph_of_too_many_samples_is_told(allow):
    net = configure("gps-net").network()
    allow(1e8)
    with pytest.raises(InputError, match=r"a window of 64 pixels .* needs .* such as --memory") as told:
        plan.side(net, 1, 1, CPU, LARGE, 3000)
    assert "\n" not in str(told.value) and plan.side(net, 1, 1, CPU, LARGE, 300) >= 64


def test_a_smaller_bound_finds_the_same(allow):
    capture = load("demo", images="1-8")
    allow(1e12)
    whole = solve(capture, "trimmed")
    allow(plan.LEVEL * 8 * 1000)  # a thousand pixels
    few = solve(capture, "trimmed")
    assert plan.pixels(capture) == 1000
    assert angle_deg(whole.map[whole.mask], few.map[whole.mask]).max() < 0.05 and np.array_equal(whole.mask, few.mask)


def test_a_command_ends_in_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(memory, "_given", None)
    assert main(["measure", "demo", "--out", str(tmp_path / "out"), "--memory", "50MB"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "such as --memory" in said and not list(tmp_path.iterdir())
