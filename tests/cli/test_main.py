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
        ("", "Expected one of {measure, score"),
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
    def fails(self):
        raise KeyError("surprise\nof two lines")

    monkeypatch.setattr(measuring.Methods, "__call__", fails)
    assert cli.main(["methods"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "KeyError" in err and "this is a fault of photonormal" in err
    file = Path(re.search(r"\S+photonormal-fault-\S+\.txt", err).group())
    told = file.read_text()
    file.unlink()
    assert "options: ['methods']" in told and "in fails" in told and "photonormal 0." in told


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
