"""Some changed stored files; `make fuzz` tries 2,000."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_changed_files_are_read_or_refused_in_one_line():
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-m", "tests.fuzz.stored_files", "--count", "36"]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "'refused': " in ended.stdout and "'done': " in ended.stdout
