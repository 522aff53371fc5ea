"""What is served, to whom, and what is not."""

import http.client
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from urllib.parse import urlsplit
from urllib.request import urlopen

import pytest

from photonormal.types import InputError
from photonormal.view.server import HOST, serve
from tests.view.conftest import relief, write_result


@pytest.fixture(scope="module")
def ask(served, result):
    """A function that gets a path, with TOKEN for the token: (status, headers, text)."""
    address = urlsplit(served(result))
    token = address.path.strip("/")

    def get(path, host=None):
        connection = http.client.HTTPConnection(address.hostname, address.port, timeout=60)
        connection.request("GET", path.replace("TOKEN", token), headers={"Host": host or address.netloc})
        answer = connection.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        connection.close()
        return found

    return get


def test_the_page_and_its_tiles_are_served(ask):
    status, headers, page = ask("/TOKEN/")
    assert status == 200 and b"woodham" in page and headers["cache-control"] == "no-store"
    for layer in ("normals", "albedo", "height", "expected", "error", "photograph-0", "photograph-11"):
        assert ask(f"/TOKEN/tile/0/{layer}/0/0/0")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        *("/", "/other/", "/other/tile/0/normals/0/0/0", "/TOKEN/tile/1/normals/0/0/0", "/TOKEN/tile/-1/normals/0/0/0"),
        *("/TOKEN/tile/0/report/0/0/0", "/TOKEN/tile/0/normals/9/0/0", "/TOKEN/tile/0/photograph-12/0/0/0"),
        *("/TOKEN/tile/0/photograph--1/0/0/0", "/TOKEN/tile/0/photograph-x/0/0/0", "/TOKEN/report.json"),
        *("/%C3%A9/", "/TOKEN/../report.json", "/TOKEN/tile/0/..%2f..%2freport.json/0/0/0", "/docs", "/openapi.json"),
    ],
)
def test_nothing_else_is(ask, path):
    assert ask(path)[0] in (404, 422)


def test_a_name_that_is_no_text_is_shown_nevertheless(served, tmp_path):
    folder = write_result(tmp_path / os.fsdecode(b"\xff #1% <b>'\""), *relief(20, 30))
    report = json.loads((folder / "report.json").read_text())
    (folder / "report.json").write_text(json.dumps(report | {"capture": ""}))
    with urlopen(served(folder)) as answer:
        assert b"<title>? #1% &lt;b&gt;&#x27;&quot;, code" in answer.read()


def test_results_of_one_capture_by_one_method_have_names_of_their_own(served, result, tmp_path):
    shutil.copytree(result, tmp_path / "again")
    with urlopen(served(result, tmp_path / "again")) as answer:
        page = answer.read().decode()
    assert f"woodham ({result.name})" in page and "woodham (again)" in page


def test_another_host_name_gets_nothing(ask):
    assert ask("/TOKEN/", "evil.example")[0] == 404


def test_the_page_may_load_nothing_from_elsewhere(ask):
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', ask("/TOKEN/")[2].decode())[1]
    assert "default-src 'none'" in policy and "unsafe" not in policy and "http" not in policy


def test_a_port_that_is_taken_is_told():
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        with pytest.raises(InputError, match=r"port \d+ is taken"):
            serve(lambda token: object(), taken.getsockname()[1], browser=False)


def test_a_port_that_is_none_is_told(result, run):
    code, _, err = run("view", result, "--port", "99999", "--no-browser")
    assert code == 2 and "--port 99999" in err and len(err.splitlines()) == 1


def test_what_is_missing_is_named(result, run, monkeypatch):
    for name in [n for n in sys.modules if n.startswith("photonormal.view.server")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fastapi", None)
    code, _, err = run("view", result, "--no-browser")
    assert code == 2 and "pip install 'photonormal[view]'" in err and len(err.splitlines()) == 1


def test_it_tells_where_the_page_is_and_ends_without_a_word(result):
    command = [sys.executable, "-m", "photonormal", "view", str(result)]
    nowhere = {**os.environ, "PATH": "/nonexistent", "DISPLAY": "", "WAYLAND_DISPLAY": ""}  # no browser is found
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=nowhere, **pipes) as process:
        assert process.stdout.readline().startswith(f"http://{HOST}:")
        assert "open the address above" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60) == ("", "") and process.returncode == 130


INTERRUPTED_EARLY = """
import asyncio, signal, sys
from photonormal_command import main
begin = asyncio.BaseEventLoop.__init__
def interrupted(self):
    signal.raise_signal(signal.SIGINT)
    begin(self)
asyncio.BaseEventLoop.__init__ = interrupted
sys.exit(main())
"""


def test_an_interrupt_while_it_begins_ends_it_without_a_word(result):
    command = [sys.executable, "-c", INTERRUPTED_EARLY, "view", str(result), "--no-browser"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith(f"http://{HOST}:") and done.stderr == "" and done.returncode == 130


@pytest.mark.skipif(sys.platform == "win32", reason="the browser is a shell script")
def test_a_browser_that_takes_the_terminal_is_answered(result, tmp_path):
    script = f"""#!{sys.executable}
import sys, urllib.request
print(urllib.request.urlopen(sys.argv[1], timeout=30).status, flush=True)
"""
    (tmp_path / "w3m").write_text(script)
    (tmp_path / "w3m").chmod(0o755)
    nowhere = {**os.environ, "PATH": str(tmp_path), "DISPLAY": "", "WAYLAND_DISPLAY": "", "TERM": "xterm"}
    command = [sys.executable, "-m", "photonormal", "view", str(result)]
    with subprocess.Popen(command, env=nowhere, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith(f"http://{HOST}:") and process.stdout.readline() == "200\n"
        process.send_signal(signal.SIGINT)
