import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(sys.platform != "linux", reason="it reads other processes' clocks")
def test_a_few_kills_lose_nothing():
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}  # processes with threads can't be forked
    command = [sys.executable, "-m", "tests.crash.crash", "--kills", "2", "--jobs", "measure", "scratch"]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
    told = ended.stdout + ended.stderr
    assert ended.returncode == 0 and "| measure | 6 |" in told and "| scratch | 6 |" in told, told


def test_a_batch_that_is_killed_is_made_whole():
    command = [sys.executable, "-m", "tests.crash.batch", "--kills", "2"]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert ended.returncode == 0 and "2 kills, 0 faults" in ended.stdout, ended.stdout + ended.stderr
