"""Which lamps are kept: the best that exchanges lead to, of which a network that measures is asked."""

import numpy as np
import pytest
import torch

from photonormal import lamp_choice
from photonormal.geometry import angle_deg, far_apart, fibonacci_hemisphere
from photonormal.lamp_choice import RigPixels, choose, exchanged
from photonormal.methods.learned.lmps import LMPSConfig, LMPSNet
from photonormal.types import InputError

RIG = fibonacci_hemisphere(12)


@pytest.fixture
def few(monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)
    monkeypatch.setattr(lamp_choice, "WINDOWS", {"crop": 8, "crops": 4, "scenes": 2, "size": 48})
    monkeypatch.setattr(lamp_choice, "PIXELS", 40)


def network():
    torch.manual_seed(0)
    net = LMPSNet(LMPSConfig(side=8, grown=4, hidden=8)).eval()
    net.turns = 1
    return net


def test_lamps_are_spread_at_first():
    lamps = far_apart(RIG, 4)
    assert RIG[lamps[0], 2] == RIG[:, 2].max() and len(set(lamps)) == 4
    apart = [angle_deg(RIG[a], RIG[b]) for a in lamps for b in lamps if a < b]
    assert min(apart) > 50


def test_exchanges_lead_to_lamps_of_which_none_is_better_exchanged():
    worth = np.random.default_rng(0).permutation(12)
    asked = []

    def error_deg(lamps):
        asked.append(lamps)
        return float(worth[lamps].sum())

    assert set(exchanged([0, 1, 2], 12, error_deg, lambda: None)) == set(np.argsort(worth)[:3].tolist())
    assert all(len(set(lamps)) == 3 for lamps in asked)


def test_the_chosen_are_better_than_those_it_began_with(few):
    net = network()
    found = choose(RIG, 4, net)
    assert len(set(found.lamps)) == 4 and list(found.lamps) == sorted(found.lamps)
    shown = RigPixels.of(RIG, lamp_choice.ASKED)
    with torch.inference_mode():
        assert shown.error_deg(net, list(found.lamps)) < shown.error_deg(net, far_apart(RIG, 4))
    assert len({found.all_deg, found.chance_deg, found.error_deg}) == 3


@pytest.mark.parametrize(
    ("lamp", "says"), [((0, 0, 0), "the light of lamp 13 is"), ((0.6, 0, -0.8), "1 of the 13 lights .* lie behind")]
)
def test_lamps_that_light_nothing_are_refused(tmp_path, lamp, says):
    np.savetxt(tmp_path / "lights.txt", [*RIG, lamp])
    with pytest.raises(InputError, match=says):
        lamp_choice.choose_from(tmp_path / "lights.txt", 4)


@pytest.mark.parametrize("count", [2, 12, 40])
def test_a_choice_needs_something_to_choose_from(count):
    with pytest.raises(InputError, match=f"--count {count} came but from 3 to 11 of these 12 lamps can be chosen"):
        choose(RIG, count)


def test_the_chosen_are_written_with_their_names(few, tmp_path, monkeypatch):
    monkeypatch.setattr(lamp_choice.LMPS, "network", lambda self: network())
    file, out = tmp_path / "dome.lp", tmp_path / "kept.lp"
    rows = "".join(f"lamp{j:02d}.png {x} {y} {z}\n" for j, (x, y, z) in enumerate(RIG))
    file.write_text(f"12\n{rows}")
    found = lamp_choice.choose_from(file, 3, out)
    lines = out.read_text().splitlines()
    assert lines[0] == "3" and [line.split()[0] for line in lines[1:]] == [f"lamp{j:02d}.png" for j in found.lamps]
    with pytest.raises(InputError, match=r"kept\.lp"):
        lamp_choice.choose_from(file, 3, out)
