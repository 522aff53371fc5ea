"""The driver notices what must not happen."""

import sys

import pytest

from tests.fuzz import drive
from tests.fuzz.drive import Driver

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver reads /proc")

STUB = """
import os, sys, time
from pathlib import Path

def main():
    match sys.argv[1]:
        case "hang": time.sleep(60)
        case "crash": os.abort()
        case "raise": raise KeyError("x")
        case "print": os.write(2, b"libpng warning\\n")
        case "colour": print("photonormal: \\x1b[31m", file=sys.stderr)
        case "write": Path("mine.txt").write_text("theirs")
        case "large": b"x" * 300_000_000
        case "refuse": print("photonormal: no.", file=sys.stderr); return 2
    return 0
"""


@pytest.fixture
def driver(tmp_path, monkeypatch):
    """A driver whose child runs the stub in place of photonormal."""
    package = tmp_path / "stub" / "photonormal"
    (package / "cli").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "cli" / "__init__.py").write_text(STUB)
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.setattr(drive, "SECONDS", 3)
    monkeypatch.setattr(drive, "PEAK_MB", 200)
    with Driver() as started:
        yield started


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("hang", "took more than"),
        ("crash", "ended the process: -6"),
        ("raise", "KeyError"),
        ("print", "printed 'libpng warning'"),
        ("colour", "printed"),
        ("write", "changed the user's 'mine.txt'"),
        ("large", "took 3"),
    ],
)
def test_each_fault_is_told(tmp_path, driver, command, says):
    folder = tmp_path / "user"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    (found,) = driver.faults(folder, command)
    assert says in found
    assert driver.faults(folder, "refuse") == driver.faults(folder, "well") == []
