"""Numbers depend on what the machine is, never on how busy it is."""

import json
import os
import subprocess
import sys

import pytest
import torch

import photonormal as pn
from photonormal.cli import main
from photonormal.geometry import angle_deg
from photonormal.methods.learned import processor
from photonormal.methods.learned.processor import computing_in, inner_precision, number_format, of_rows
from photonormal.types import InputError

CPU = torch.device("cpu")
BUSY = "while True: pass"
MEASURE = [sys.executable, "-m", "photonormal", "measure", "demo", "--images", "1-6", "--no-mesh"]


def measured(folder, *options):
    command = [*MEASURE, "--out", str(folder), *options]
    subprocess.run(command, check=True, capture_output=True)
    return (folder / "normals.npz").read_bytes(), json.loads((folder / "report.json").read_text())["precision"]


def test_two_runs_give_the_same_bits_also_beside_a_busy_process(tmp_path):
    quiet = measured(tmp_path / "quiet")
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(os.cpu_count() or 1)]
    try:
        assert measured(tmp_path / "busy") == quiet
    finally:
        for process in busy:
            process.kill()
            process.wait()


def test_precision_is_what_was_asked_for(tmp_path):
    a, b = (measured(tmp_path / name, "--precision", name) for name in ("float32", "bf16"))
    assert (a[1], b[1]) == ("float32", "bf16") and a[0] != b[0]


def test_it_is_asked_for_inside_a_block_only():
    with computing_in("bf16"):
        assert number_format(CPU) == "bf16"
        with inner_precision(CPU):
            assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.bfloat16
        with computing_in("float32"), inner_precision(CPU):
            assert (torch.ones(2, 2) @ torch.ones(2, 2)).dtype == torch.float32
    assert number_format(CPU) == "float32"  # as tests compute


def test_auto_is_bf16_where_the_machine_knows_it(monkeypatch):
    monkeypatch.setattr(processor, "knows_bf16", lambda device_type: device_type == "cuda")
    assert [number_format(torch.device(d)) for d in ("cpu", "cuda")] == ["float32", "bf16"]


def test_auto_leaves_normalnet_exact_on_a_processor(monkeypatch):
    monkeypatch.setattr(processor, "knows_bf16", lambda device_type: True)
    found = pn.measure(pn.load("demo", images="1-6"), "normalnet", integration=None).report
    assert found is not None and found["precision"] == "float32"
    assert [number_format(torch.device(d), exact=True) for d in ("cpu", "cuda")] == ["float32", "bf16"]
    with computing_in("bf16"):
        assert number_format(CPU, exact=True) == "bf16"


@pytest.mark.parametrize("rows", [5, 64])
def test_a_layer_of_rows_is_the_layer(rows):
    layer, x = torch.nn.Linear(6, 3), torch.rand(rows, 6)
    torch.testing.assert_close(of_rows(layer, x), layer(x))


def test_an_unknown_one_is_refused():
    with pytest.raises(InputError, match="precision fp8 came but auto, float32 or bf16 is needed"):
        pn.measure(pn.load("demo"), precision="fp8")


def test_the_report_of_a_classical_method_says_none(tmp_path):
    assert main(["measure", "demo", "--method", "woodham", "--no-mesh", "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "report.json").read_text())["precision"] is None


def test_normals_hardly_move_in_bf16():
    capture, found = pn.load("demo", images="1-12"), {}
    for name in ("float32", "bf16"):
        with computing_in(name):
            found[name] = pn.solve(capture, "normalnet").map[capture.mask]
    assert 0 < angle_deg(*found.values()).mean() < 0.03
