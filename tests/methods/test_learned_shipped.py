"""The weights that come with the package are whole, say where they come from, and do better than their prior."""

import pytest
import torch

import photonormal as pn
from photonormal.methods import DEFAULT, METHODS, method_class
from photonormal.methods.learned.method import Weighted
from photonormal.methods.learned.processor import computing_in
from photonormal.methods.learned.weights import LIGHTS, checksum, load_network, shipped, stated_checksum
from photonormal.methods.uncalibrated.guess import guess
from photonormal.scoring.lights import score_lights
from photonormal.train.validate import OBJECTS

SHIPPED = sorted(path.stem for path in shipped("x").parent.glob("*.safetensors"))


def test_every_learned_method_has_weights_and_all_weights_a_method():
    learned = [cls for name in METHODS if issubclass(cls := method_class(name), Weighted)]
    assert SHIPPED == sorted({LIGHTS, *(cls().file.stem for cls in learned)})


@pytest.mark.parametrize("name", SHIPPED)
def test_weights_and_card_belong_together(name):
    path = shipped(name)
    net = load_network(path)
    assert bool(net.config.prior) == (name in ("normalnet", "lambertian-prior")) and path.stat().st_size < 20e6
    assert stated_checksum(path) == checksum(path)
    card = path.with_suffix(".md").read_text()
    for fact in ("command", "seed", "minutes", "device", "licence", "learned from"):
        assert fact in card, f"the card of {name} does not say its {fact}"


def test_all_weights_together_are_small():
    assert sum(shipped(name).stat().st_size for name in SHIPPED) < 40e6


def test_the_default_is_better_than_its_prior_and_least_squares_on_the_demonstration():
    capture = pn.load("demo")
    errors = [pn.score(pn.solve(capture, m), capture.truth).mean_deg for m in (DEFAULT, "trimmed", "woodham")]
    assert errors[0] == min(errors)


def test_it_tells_how_far_it_can_be_trusted():
    capture = pn.load("demo")
    told = pn.solve(capture, device="cpu").expected_error_deg
    assert told is not None and 0 < told[capture.mask].min() and told[capture.mask].max() <= 90


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_the_card_s_figures_hold(name, data):
    """A real object, all images: the mean error is the one on the card, to a tenth of a degree."""
    card = shipped(name).with_suffix(".md").read_text()
    found = card[card.index("## Real objects") :].splitlines()[4].strip("| ").split(" | ")
    numbers = "bf16" if "| learned in | bf16 |" in card else None  # in which the card's figures were measured
    for obj, stated in zip(OBJECTS[:1], found, strict=False):
        path = data / "diligent" / "pmsData" / f"{obj}PNG"
        capture, raw = pn.load(path), pn.load(path, lights="unknown")
        if name == LIGHTS:
            told = guess(load_network(shipped(name)), raw, torch.device("cpu"))
            off = score_lights(told.lights.numpy(), capture.known_lights()).mean_deg
            assert off == pytest.approx(float(stated), abs=0.1)
            continue
        shown = raw if method_class(name).needs.finds_lights else capture
        with computing_in(numbers):
            found_deg = pn.score(pn.solve(shown, name, device="cpu"), capture.truth).mean_deg
        assert found_deg == pytest.approx(float(stated), abs=0.1)
