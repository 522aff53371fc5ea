"""Rows of a capture that are solved apart make the same as the whole."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.methods import configure
from photonormal.methods.engine import parts, plan, run, stream
from photonormal.methods.engine.parts import divided, joined
from tests.methods.engine.test_stream import KINDS, PASSES, network, sphere
from tests.scenes import lambertian, ring
from tests.scenes import sphere as matt

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def small_windows(monkeypatch):
    monkeypatch.setattr(parts, "STEP", 32)
    monkeypatch.setattr(parts, "LEAST", 32)


@pytest.mark.parametrize("method", ["trimmed", "woodham", "l1"])
def test_parts_by_pixel_are_the_whole(method, monkeypatch):
    capture, solver = lambertian(matt(160), ring(6)), configure(method)
    monkeypatch.setattr("photonormal.methods.inputs.grey.READ", 40_000)  # fewer samples tell of the whole
    whole = run(solver, capture, CPU).normals
    monkeypatch.setattr(plan, "LEVELS", 6 * 4000)
    rows = divided(solver, capture, 3)
    assert len(rows) == 3
    found = joined([run(solver, capture, CPU, part) for part in rows], capture).normals
    assert torch.allclose(found, whole, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_parts_by_windows_are_the_whole(kind):
    capture, _ = sphere(n=4, size=150)
    net, how = network(kind), {"passes": PASSES.get(kind, 1), "side": 32}
    whole = stream.measured(net, capture, CPU, **how)
    rows = divided(configure("normalnet"), capture, 4)
    assert len(rows) == 4
    found = joined([stream.measured(net, capture, CPU, rows=part, **how) for part in rows], capture)
    assert torch.allclose(found.normals, whole.normals, atol=1e-5)
    assert whole.told_deg is None or torch.allclose(found.told_deg, whole.told_deg, rtol=1e-4)


def test_parts_are_about_equal_and_hold_every_row_once():
    capture = lambertian(matt(160), ring(6))
    for count in (1, 2, 3, 9):
        rows = divided(configure("trimmed"), capture, count)
        assert [r.start for r in rows[1:]] == [r.stop for r in rows[:-1]] and len(rows) <= count
        assert rows[0].start == 0 and rows[-1].stop == 160
        assert min(int(capture.mask[r].sum()) for r in rows) > 0
    first, second = (int(capture.mask[r].sum()) for r in divided(configure("trimmed"), capture, 2))
    assert abs(first - second) < 0.2 * (first + second)
    small = replace(capture, mask=capture.mask & (np.arange(160) < 100)[:, None] & (np.arange(160) > 75)[:, None])
    assert divided(configure("trimmed"), small, 2) == [slice(0, 160)]


@pytest.mark.parametrize("method", ["ward", "normalnet:fast=true"])
def test_a_method_that_looks_at_the_whole_is_not_divided(method):
    name, *options = method.split(":")
    solver = configure(name, **({"fast": True} if options else {}))
    assert len(divided(solver, lambertian(matt(160), ring(6)), 3)) == 1
