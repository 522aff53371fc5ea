"""Results of a matt sphere, and one of 24 megapixels, made by code."""

import json
import subprocess
import sys

import cv2
import numpy as np
import pytest

from photonormal.cli import main
from photonormal.types import Normals
from tests.scenes import lambertian, ring, sphere, write_diligent


@pytest.fixture(scope="session")
def capture(tmp_path_factory):
    """Twelve photographs of a sphere, with its true normals."""
    folder = tmp_path_factory.mktemp("captures") / "ball"
    write_diligent(folder, lambertian(sphere(96), ring(11, 50)))
    return folder


@pytest.fixture(scope="session")
def result(capture, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "woodham"
    assert main(["measure", str(capture), "--out", str(out), "--method", "woodham"]) == 0
    return out


@pytest.fixture(scope="session")
def other(capture, tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "trimmed"
    assert main(["measure", str(capture), "--out", str(out), "--method", "trimmed"]) == 0
    return out


def relief(h, w):
    """A wavy ellipse: heights in pixels, NaN outside, and their normals."""
    y, x = np.mgrid[:h, :w].astype(np.float32)
    height = 12 * np.sin(x / 60) * np.cos(y / 45)
    mask = (x - w / 2) ** 2 / (w / 2.1) ** 2 + (y - h / 2) ** 2 / (h / 2.1) ** 2 < 1
    map = np.stack(
        [-12 / 60 * np.cos(x / 60) * np.cos(y / 45), -12 / 45 * np.sin(x / 60) * np.sin(y / 45), np.ones_like(x)],
        axis=-1,
    )
    map /= np.linalg.norm(map, axis=-1, keepdims=True)
    map[~mask] = 0
    return np.where(mask, height, np.nan), Normals(map, mask)


def write_result(folder, height, normals, mm_per_px=None):
    """A result folder as `measure` writes it, without photographs."""
    folder.mkdir(parents=True)
    expected = np.where(normals.mask, np.float32(4), np.float32(np.nan))
    np.savez(folder / "normals.npz", normals=normals.map, mask=normals.mask, expected_error_deg=expected)
    np.savez(folder / "depth.npz", depth=height.astype(np.float32), mask=normals.mask)
    albedo = np.full((*height.shape, 3), 30000, np.uint16)
    albedo[~normals.mask] = 0
    cv2.imencode(".png", albedo, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tofile(folder / "albedo.png")
    report = {"capture": "relief", "method": "code", "lights": 0, "reading": {"mm_per_px": mm_per_px}}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


@pytest.fixture(scope="session")
def large(tmp_path_factory):
    """24 megapixels, 0.02 mm each."""
    return write_result(tmp_path_factory.mktemp("large") / "relief", *relief(4000, 6000), mm_per_px=0.02)


@pytest.fixture(scope="session")
def served():
    """A function that runs `photonormal view` and gives its address."""
    pytest.importorskip("fastapi")
    running = []

    def serve(*arguments):
        command = [sys.executable, "-m", "photonormal", "view", *map(str, arguments), "--no-browser"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        running.append(process)
        return process.stdout.readline().strip()

    yield serve
    for process in running:
        process.terminate()
        process.wait()
        process.stdout.close()
