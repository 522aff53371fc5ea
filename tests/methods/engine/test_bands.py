"""A large picture passes through a network some rows after the other: each pixel once a pass, and little is kept."""

import torch

from photonormal.methods.engine import bands, plan
from photonormal.methods.engine.bands import Around, Rows
from photonormal.methods.engine.prior import first_look
from photonormal.methods.engine.stream import measured
from photonormal.methods.engine.task import Task
from photonormal.methods.engine.windows import Box
from tests.methods.engine.test_stream import network, sphere

CPU = torch.device("cpu")


def test_each_pixel_is_looked_at_once_a_pass_and_told_once():
    capture, _ = sphere(n=3, size=150)
    net = network("normalnet-far")
    box = Box.of(capture, net.stride)
    with torch.inference_mode():
        look = first_look(net.scaling, capture, box, CPU, None)
        (window,) = box.windows((1000, 1000), 0)
        looked_at: list[int] = []
        told = list(bands.looked(net, Task(capture, box, look, CPU, 1, 2, 16, looked_at.append), window))
    assert sum(looked_at) == 2 * 3 * capture.mask.sum()
    assert [core[0].start for core, _ in told] == list(range(0, len(box.mask), 16))
    assert all(values.shape[1:] == box.mask[core].shape for core, values in told)


def test_rows_are_told_when_those_around_are_there_and_then_forgotten():
    net = network("normalnet-far")
    h, w = 40 * 8, 16
    around, told, kept = Around(net, 4, 0, torch.ones(h, w, dtype=torch.bool)), 0, []
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
    rows, all = Rows(4), torch.rand(1, 2, 10, 6)
    for some in all.split(3, dim=2):
        rows.add(some)
    assert rows.end == 40 and torch.equal(rows.between((slice(8, 28), slice(4, 20))), all[:, :, 2:7, 1:5])
    rows.forget(27)
    assert rows.start == 6 and rows.end == 40
    assert torch.equal(rows.between((slice(24, 40), slice(0, 24))), all[:, :, 6:])


def test_columns_looked_at_apart_are_the_whole(monkeypatch):
    capture, _ = sphere(n=4, size=110)
    net = network("normalnet-far")
    whole = measured(net, capture, CPU).normals
    monkeypatch.setattr(plan, "TILE", 6000)
    assert torch.allclose(measured(net, capture, CPU).normals, whole, atol=1e-5)
