"""Fixtures shared by all tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def float32(monkeypatch):
    """No bf16 inside networks, whatever the machine is fast with: what is exact is exact to float32's rounding."""
    from photonormal.methods.learned import processor

    monkeypatch.setattr(processor, "knows_bf16", lambda device_type: False)


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder with real captures and ground truth (PHOTONORMAL_DATA, or ../shared/data beside the checkout)."""
    folder = Path(os.environ.get("PHOTONORMAL_DATA", Path(__file__).parents[1] / ".." / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no real captures here; set PHOTONORMAL_DATA")
    return folder.resolve()


@pytest.fixture
def run(capsys):
    """Run the command line: (exit code, standard output, standard error)."""
    from photonormal.cli import main

    def call(*arguments):
        code = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call
