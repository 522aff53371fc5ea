"""How far the work is, told where there is no terminal."""

import re
import time

import numpy as np

from photonormal import load, progress, solve
from photonormal.methods.engine import samples, stream


def test_lines_tell_the_time_that_is_left(monkeypatch, capsys):
    monkeypatch.setattr(progress, "EVERY", 0.02)
    with progress.progress("reading", 4) as advance:
        advance()
        advance(2)
        time.sleep(0.2)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    assert all(re.fullmatch(r"photonormal: reading: 75 % after \d seconds, \d seconds left", text) for text in lines)
    time.sleep(0.1)
    assert capsys.readouterr().err == ""  # it has ended


def test_what_is_short_says_nothing(capsys):
    with progress.progress("reading", 2) as advance:
        advance()
    assert capsys.readouterr().err == ""


def test_every_step_of_a_method_is_counted(monkeypatch):
    done, totals = [], []

    class Counted:
        def __init__(self, title, total=None):
            totals.append(total)

        def __enter__(self):
            return lambda steps=1: done.append(steps)

        def __exit__(self, *error):
            pass

    capture = load("demo", images="1-6", crop="40,40,48,48")
    for module, method in ((samples, "trimmed"), (stream, "normalnet")):
        done.clear()
        totals.clear()
        monkeypatch.setattr(module, "progress", Counted)
        solve(capture, method, device="cpu")
        assert totals[-1] == sum(done)
    assert np.array(done).sum() % 6 == 0  # windows x images x passes
