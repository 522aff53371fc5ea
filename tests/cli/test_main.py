import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from photonormal import cli
from photonormal.cli import measuring

COMMAND = [sys.executable, "-c", "import sys; from photonormal_command import main; sys.exit(main())"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("measure", "Missing from photonormal measure: PATH --out FOLDER; see photonormal measure --help."),
        ("measure a --out b --mehtod x", "Unrecognized options: --mehtod, x; perhaps --method is meant; see"),
        ("bench diligent x --jobs a", "--jobs 'a' came but a whole number is needed"),
        ("measure a --out", "Missing value for argument '--out'. Expected 1 values; see"),
        ("measure a --out b --ring eight", "--ring 'eight' came but a whole number is needed; correct it."),
        ("measure a --out b --mm-per-px 0,1", "--mm-per-px '0,1' came but a number is needed; correct it."),
        ("measuer a", "no command 'measuer'; perhaps measure is meant; choose from measure, score"),
        ("measure demo --out b --method wodham", "no method 'wodham'; perhaps woodham is meant; choose from"),
        ("", "Expected one of {measure, score"),
        ("measure a --out b --prefer jpg", "no --prefer 'jpg'; perhaps jpeg is meant; choose from raw, jpeg, tiff"),
        ("convert a --out b --frame opngl", "no --frame 'opngl'; perhaps opengl is meant; choose from"),
        ("render objcts --out b", "no recipe 'objcts'; perhaps objects is meant; choose from"),
        (
            "measure demo --out b --method a.safetensors",
            "a.safetensors holds weights but a method is needed; give",
        ),
        ("measure a --out b --ambient x", "Unrecognized options: --ambient, x; see photonormal measure --help."),
        (
            "calibrate a --ring 8",
            "photonormal calibrate has no option --ring, but batch, check, intensities, measure, watch",
        ),
    ],
)
def test_wrong_options_are_one_line(capsys, words, says):
    assert cli.main(words.split()) == 2
    out, err = capsys.readouterr()
    assert err.startswith(f"photonormal: {says}") and err.count("\n") == 1 and out == ""


def test_help_is_printed(capsys):
    for words in (["--help"], ["measure", "--help"]):
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        assert ended.value.code == 0
        assert "usage: photonormal" in capsys.readouterr().out


def test_a_fault_of_ours_is_one_line_and_a_file(capsys, monkeypatch):
    code = "def fails(self): raise KeyError('surprise\\nof two lines')"
    exec(code, scope := {})  # of no user's file
    monkeypatch.setattr(measuring.Methods, "__call__", scope["fails"])
    assert cli.main(["methods"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "KeyError" in err and "this is a fault of photonormal" in err
    file = Path(re.search(r"\S+photonormal-fault-\S+\.txt", err).group())
    told = file.read_text()
    file.unlink()
    assert "options: ['methods']" in told and "in fails" in told and "photonormal 0." in told


MINE = """
import sys
from dataclasses import dataclass
from typing import ClassVar
from photonormal.cli import main
from photonormal.methods import METHODS
from photonormal.methods.contract import Needs, Solution

METHODS["mine"] = "mine:Mine"

@dataclass(frozen=True)
class Mine:
    shape: str = "missing"
    needs: ClassVar[Needs] = Needs()

    def __call__(self, seen):
        return Solution(seen.I.numpy()[:, :3] if self.shape == "array" else seen.I[:, :3].T if self.shape else seen.J)

if __name__ == "__main__":
    sys.exit(main())
"""


def test_a_fault_of_a_user_s_own_method_is_told_by_its_place(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    line = 1 + MINE.splitlines().index(next(line for line in MINE.splitlines() if "seen.J" in line))
    for shape, code, says in (
        ("", 1, f"raised in mine.py, line {line}, which is no part of photonormal; the traceback is in "),
        ("array", 2, "a method returned normals as ndarray of ("),
        ("turned", 2, "a torch.Tensor (p, 3), a row a pixel, is needed."),
    ):
        words = ["measure", "demo", "--method", f"mine:shape={shape}", "--out", "result"]
        run = subprocess.run([sys.executable, "mine.py", *words], cwd=tmp_path, capture_output=True, text=True)
        assert run.returncode == code and says in run.stderr and "fault of photonormal" not in run.stderr
        assert run.stderr.count("\n") == 1 and not (tmp_path / "result").exists()
        for file in re.findall(r"\S+photonormal-fault-\S+\.txt", run.stderr):
            Path(file).unlink()


def test_without_a_place_for_the_file_it_is_still_one_line(capsys, monkeypatch):
    def fails(self):
        raise RuntimeError("surprise")

    def full(**_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(measuring.Methods, "__call__", fails)
    monkeypatch.setattr("tempfile.mkstemp", full)
    assert cli.main(["methods"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("seconds", [0.1, 0.4, 1.5])
def test_a_signal_ends_a_command_cleanly(tmp_path, number, seconds):
    out = tmp_path / "result"
    run = subprocess.Popen(
        [*COMMAND, "measure", "demo", "--out", out, "--method", "ward"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(seconds)
    running = run.poll() is None
    run.send_signal(number)
    _, err = run.communicate(timeout=60)
    assert "Traceback" not in err and "fault" not in err
    if running:
        assert run.returncode == 128 + number, err
        assert not out.exists() or (out / "report.json").exists()
