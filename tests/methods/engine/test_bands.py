"""A large picture passes through a network some rows after the other: each pixel once a pass, and little is kept."""

import pytest
import torch

from photonormal.methods import configure
from photonormal.methods.contract import Solution
from photonormal.methods.engine import bands, parts, plan
from photonormal.methods.engine.bands import Around, KnownRows, Look
from photonormal.methods.engine.parts import divided, joined
from photonormal.methods.engine.prior import first_look
from photonormal.methods.engine.stream import measured
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.windows import Box
from photonormal.methods.learned.processor import computing_in
from tests.methods.engine.test_stream import network, sphere

CPU = torch.device("cpu")


def test_each_pixel_is_looked_at_once_a_pass_and_told_once(monkeypatch):
    monkeypatch.setattr(plan, "ROWS", 16)
    monkeypatch.setattr(plan, "BLOCK", 0)
    capture, _ = sphere(n=3, size=150)
    net = network("normalnet-far")
    box = Box.of(capture, net.stride)
    with torch.inference_mode():
        look = first_look(net.scaling, capture, box, CPU, None)
        (window,) = box.windows((1000, 1000), 0)
        looked_at: list[int] = []
        told = list(bands.looked(net, Task(capture, box, look, CPU, 1, 2, 16, looked_at.append), window))
    assert sum(looked_at) == 2 * 3 * capture.mask.sum()
    assert [core[0].start for core, _ in told[1:]] == [core[0].stop for core, _ in told[:-1]]
    assert told[0][0][0].start == 0 and told[-1][0][0].stop == len(box.mask)
    assert all(values.shape[1:] == box.mask[core].shape for core, values in told)


def test_rows_are_told_when_those_around_are_there_and_then_forgotten(monkeypatch):
    monkeypatch.setattr(plan, "ROWS", 8)
    monkeypatch.setattr(plan, "BLOCK", 0)
    net = network("normalnet-far")
    h, w = 40 * 8, 16
    look = Look((slice(0, h), slice(0, w)), (slice(0, h), slice(0, w)), 0)
    around, told, kept = Around(net, 4, 0, torch.ones(h, w, dtype=torch.bool), look), 0, []
    with torch.inference_mode():
        for y in range(0, h, 8):
            frame = torch.zeros(1, 5, 8, w)
            frame[:, [0, 4]] = 1
            part = around.add({"digested": torch.rand(1, net.config.width, 8, w), "frame": frame})
            assert y + 8 - told <= net.reach + 4 * net.stride or y + 8 == h
            told += 0 if part is None else part.shape[2]
            kept.append(max(rows.end - rows.stride * rows.start for rows in around.kept.values()))
    assert told == h and max(kept) <= net.reach + 6 * net.stride


def test_a_part_of_the_rows_that_are_kept_is_what_came():
    rows, all = KnownRows(4, 0, slice(0, 24)), torch.rand(1, 2, 10, 6)
    for some in all.split(3, dim=2):
        rows.add(some)
    assert rows.end == 40 and torch.equal(rows.between((slice(8, 28), slice(4, 20))), all[:, :, 2:7, 1:5])
    rows.forget(27)
    assert rows.start == 6 and rows.end == 40
    assert torch.equal(rows.between((slice(24, 40), slice(0, 24))), all[:, :, 6:])


def test_what_lies_beyond_the_window_is_zero():
    rows, all = KnownRows(4, 8, slice(16, 40)), torch.rand(1, 2, 10, 6)
    rows.add(all)
    seen = rows.between((slice(0, 16), slice(12, 24)))
    assert torch.equal(seen[:, :, 2:, 1:], all[:, :, :2, :2]) and seen.count_nonzero() == 8
    assert torch.equal(rows.between((slice(44, 60), slice(28, 48)))[:, :, :1, :3], all[:, :, 9:, 3:])


def test_columns_looked_at_apart_are_the_whole(monkeypatch):
    capture, _ = sphere(n=4, size=110)
    net = network("normalnet-far")
    whole = measured(net, capture, CPU).normals
    monkeypatch.setattr(plan, "TILE", 6000)
    assert torch.allclose(measured(net, capture, CPU).normals, whole, atol=1e-5)


@pytest.mark.parametrize("precision", ["float32", "bf16"])
def test_bands_windows_and_parts_have_the_normals_of_the_whole(precision, monkeypatch):
    capture, _ = sphere(n=4, size=190)
    net, solver = network("normalnet-full"), configure("normalnet")
    for name, value in (("BLOCK", 0), ("ROWS", 40), ("TILE", 3000)):
        monkeypatch.setattr(plan, name, value)
    for name in ("STEP", "LEAST"):
        monkeypatch.setattr(parts, name, 32)

    def found(wide: int, high: int, count: int = 1) -> Solution:
        monkeypatch.setattr(plan, "tile", lambda *_: ((1000, wide), high))
        rows = divided(solver, capture, count)
        assert len(rows) == count
        with computing_in(precision):
            return joined([measured(net, capture, CPU, passes=2, rows=some) for some in rows], capture)

    whole = found(1000, 1000)
    monkeypatch.setattr(plan, "LEVELS", 4 * 5000)  # the prior's rows and pixels, too
    for some in (found(1000, 48), found(72, 96, count=2)):
        assert torch.allclose(some.normals, whole.normals, rtol=0, atol=1e-5)
        assert torch.allclose(some.told_deg, whole.told_deg, rtol=1e-4)
