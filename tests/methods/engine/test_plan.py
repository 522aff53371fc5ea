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
    net = configure("lambertian-prior").network()
    sides = []
    for nbytes in (5e9, 8e9, 20e9, 200e9):
        allow(nbytes)
        (side, _), _ = plan.tile(net, 1, rotations, CPU, LARGE, 8)
        assert side % net.stride == 0 and 64 <= side <= plan.SIDE["cpu"]
        assert rotations * plan.SEEN * (side + 2 * net.reach) ** 2 <= plan.WINDOW * nbytes
        sides.append(side)
    assert sides == sorted(sides) and sides[-1] == plan.SIDE["cpu"]


def test_a_window_has_room_for_each_pixel_s_lights(allow):
    net = configure("psfcn").network()
    allow(8e9)
    (side, _), _ = plan.tile(net, 1, 1, CPU, LARGE, 100, near=True)
    assert (plan.SEEN + 100 * 36) * (side + 2 * net.reach) ** 2 <= plan.WINDOW * 8e9
    assert side < plan.tile(net, 1, 1, CPU, LARGE, 100)[0][0]


@pytest.mark.parametrize("rotations", [1, 4])
def test_rows_of_a_network_that_sees_pixels_fit_into_their_share(allow, rotations):
    net = configure("normalnet").network()
    found = []
    for nbytes in (3e9, 5e9, 20e9, 200e9):
        allow(nbytes)
        (h, w), rows = plan.tile(net, 2, rotations, CPU, LARGE, 8)
        assert h == LARGE[0] and w % net.stride == rows % net.stride == 0
        seen = [min(w + around * net.reach, LARGE[1]) for around in (4, 2)]  # in each pass
        held = sum(seen) * rotations * plan.KEPT * (rows + net.reach)
        read = seen[0] * rows * (rotations * plan.BAND + 8 * plan.SAMPLE)
        tiles = plan.at_once() * plan.SEEN * plan.TILE
        assert plan.LOADED + plan.MASKS * h * LARGE[1] + plan.SLACK * (tiles + held + read) <= nbytes
        found.append((w, rows))
    assert found == sorted(found) and found[-1] == (LARGE[1], plan.MOST)
    assert plan.tile(net, 2, 1, CPU, LARGE, 8, side=30) == ((LARGE[0], 24), 128)


def test_columns_that_are_looked_at_together_are_all_columns():
    for width, rows, reach in ((4000, 80, 8), (4000, 10**6, 72), (64, 10, 0)):
        tiles = plan.tiles(width, rows, reach, 8)
        assert tiles[0].start == 0 and tiles[-1].stop == width
        assert [t.start for t in tiles[1:]] == [t.stop for t in tiles[:-1]] and all(t.start % 8 == 0 for t in tiles)


def test_what_is_too_small_is_told(allow):
    net, capture = configure("normalnet").network(), load("demo")
    allow(1e8)
    with pytest.raises(InputError, match=r"a band of 64 rows of 64 pixels .* needs .* such as --memory"):
        plan.tile(net, 2, 1, CPU, LARGE, 8)
    allow(5e8)
    assert plan.tile(net, 2, 1, CPU, (96, 96), 8) == ((96, 96), 96)  # what is small is seen as a whole
    memory.hold(pictures := np.empty(10**8, np.uint8))
    with pytest.raises(InputError, match=r"beside libraries .* needs .* MB but 500 MB .* such as --memory"):
        plan.tile(net, 2, 1, CPU, (96, 96), 8)
    del pictures
    plan.tile(net, 2, 1, CPU, (96, 96), 8)
    allow(1e4)
    with pytest.raises(InputError, match=r"a row of 160 pixels .* needs .* such as --memory"):
        plan.pixels(capture)


def test_a_graph_of_too_many_samples_is_told(allow):
    net = configure("gps-net").network()
    allow(1.5e9)
    with pytest.raises(InputError, match=r"a band of 64 rows .* needs .* such as --memory") as told:
        plan.tile(net, 1, 1, CPU, LARGE, 100_000)
    assert "\n" not in str(told.value) and plan.tile(net, 1, 1, CPU, LARGE, 300)[1] >= 64


def test_a_smaller_bound_finds_the_same(allow):
    capture = load("demo", images="1-8")
    allow(1e12)
    whole = solve(capture, "trimmed")
    allow(plan.LITTLE * plan.LEVEL * 8 * 1000)  # a thousand pixels
    few = solve(capture, "trimmed")
    assert plan.pixels(capture) == 1000
    assert angle_deg(whole.map[whole.mask], few.map[whole.mask]).max() < 0.05 and np.array_equal(whole.mask, few.mask)


def test_a_command_ends_in_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(memory, "_given", None)
    assert main(["measure", "demo", "--out", str(tmp_path / "out"), "--memory", "50MB"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "such as --memory" in said and not list(tmp_path.iterdir())
