"""The report: one file, whole, and working in a browser."""

import base64
import hashlib
import http.server
import json
import queue
import re
import shutil
import subprocess
import threading

import cv2
import numpy as np
import pytest

from photonormal.bench.page import write_page
from photonormal.bench.store import read_truth
from photonormal.bench.tables import tables
from photonormal.export import load_normals
from photonormal.scoring import error_map_deg
from tests.view.test_planes import inflated

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome")) if p), None)
ACTS = """
addEventListener("load", async () => {
  while (!document.body.dataset.ready) await new Promise((again) => setTimeout(again, 50));
  const {ready, error} = document.body.dataset, said = {ready, error}, table = document.querySelector("table");
  const first = () => [...table.tBodies[0].rows].map((r) => r.cells[0].textContent);
  const button = [...table.tHead.rows[0].cells].find((c) => c.textContent === "ball").firstElementChild;
  button.click(); said.up = first();
  button.click(); said.down = first();
  said.wide = document.documentElement.scrollWidth <= innerWidth;
  const set = (id, value, kind) => { at(id).value = value; at(id).dispatchEvent(new Event(kind)); };
  set("object", "1", "change");
  await compare.choose(1);
  set("left", "photograph", "change"); set("right", "true normals", "change"); set("wipe", "25", "input");
  await compare.pick();
  said.clip = at("line").style.left;
  const pictures = at("pictures").getContext("webgl2"), colour = (x) => {
    const found = new Uint8Array(4);
    const {drawingBufferWidth: w, drawingBufferHeight: h, RGBA, UNSIGNED_BYTE} = pictures;
    pictures.readPixels(Math.round(x * w), h >> 1, 1, 1, RGBA, UNSIGNED_BYTE, found);
    return [...found];
  };
  if (pictures) { said.left = colour(0.22); said.right = colour(0.5); }
  said.drawn = document.body.dataset.drawn;
  const gl = at("surface").getContext("webgl2"), pixel = new Uint8Array(4);
  if (gl) { gl.readPixels(240, 240, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); said.pixel = [...pixel]; }
  fetch("/said", {method: "POST", body: JSON.stringify(said)});
});
"""
EVIL = ("x/* data */", "<img src=x onerror=attacked()>", "</script><script>attacked()</script>", "[[data]][[script]]")
LOOKS = """
addEventListener("load", async () => {
  while (!document.body.dataset.ready) await new Promise((again) => setTimeout(again, 50));
  const {ready, error} = document.body.dataset, said = {ready, error};
  said.images = document.images.length;
  said.scripts = document.scripts.length;
  said.objects = [...at("object").options].map((o) => o.textContent);
  said.heads = [...document.querySelectorAll("thead th")].map((h) => h.textContent);
  fetch("/said", {method: "POST", body: JSON.stringify(said)});
});
"""


def acting(page, script):
    """The page with a script of the test, which its policy is told of; its own parts run under its own rules."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = page.replace("script-src '", f"connect-src 'self'; script-src 'sha256-{digest}' '", 1)
    return page.replace("</body>", f"<script>{script}</script></body>")


@pytest.fixture(scope="module")
def page(runs, tmp_path_factory):
    return write_page(runs, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture(scope="module")
def data(page):
    text = re.search(r'id="data">(.*?)</script>', page.read_text(), re.DOTALL)
    return json.loads(text[1])


def browser(profile, *arguments):
    command = [CHROMIUM, "--headless", "--no-sandbox", f"--user-data-dir={profile}", "--window-size=1280,1400"]
    return [*command, "--hide-scrollbars", *arguments]


def what_it_says(text, profile):
    """What a page posts to /said once it has acted, however long a busy machine takes."""
    said = queue.Queue()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200 if self.path == "/" else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(text.encode() if self.path == "/" else b"")

        def do_POST(self):
            said.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        shown = subprocess.Popen(browser(profile, "--remote-debugging-port=0", address), **silent)  # stays open
        try:
            return said.get(timeout=120)
        finally:
            shown.kill()
            shown.wait()
            server.shutdown()


def test_nothing_is_loaded_from_elsewhere(page):
    text = page.read_text()
    assert not re.search(r"""<\w[^>]*\s(src|href)\s*=|url\(|@import|https?://|\bimport\s|fetch\(""", text)
    assert not re.search(r"\[\[\w+\]\]", text)
    assert "default-src 'none'; img-src data:; style-src 'sha256-" in text and "unsafe" not in text


def test_it_holds_every_object_and_method(data):
    assert [o["name"] for o in data["objects"]] == ["ball", "bear", "cat"]
    assert all(set(o["scores"]) == {"woodham", "trimmed"} and o["layers"]["truth"] for o in data["objects"])


def test_error_levels_are_the_errors(runs, data):
    ball = data["objects"][0]
    tile = base64.b64decode(ball["tiles"]["error:woodham"])
    levels = inflated(tile, (ball["height"] + 2, ball["width"] + 2, 1), np.uint8)[1:-1, 1:-1, 0]
    truth = read_truth(runs / "truth" / "diligent" / "ball.npz").normals
    expected = error_map_deg(load_normals(runs / "woodham" / "diligent" / "ball.npz"), truth)
    known = levels != data["unknown"]
    assert known.sum() == np.isfinite(expected).sum()
    inside = expected[np.isfinite(expected)]
    assert np.abs(levels[known] / data["levels_per_degree"] - inside).max() <= 0.126


def test_the_surface_of_a_sphere_is_round(data):
    s = data["objects"][0]["surface"]
    level = np.frombuffer(base64.b64decode(s["levels"]), "<u2").reshape(s["height"], s["width"])
    middle = level[s["height"] // 2, s["width"] // 2]
    assert middle > 0.95 * level.max() and (level[0] == 0).all()


def test_tables_are_those_of_the_table_command(runs, page):
    text = page.read_text()
    for table in tables(runs):
        assert f"<h2>{table.title}</h2>".replace("'", "&#x27;") in text
        for row in table.rows:
            assert f"{row.cells['cat'].value:.2f}" in text


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_it_works_in_a_browser(runs, page, tmp_path):
    said = what_it_says(acting(page.read_text(), ACTS), tmp_path / "profile")
    assert said["ready"] == "yes" and "error" not in said
    errors = {r.label: r.cells["ball"].value for r in tables(runs)[0].rows}
    assert said["up"] == sorted(errors, key=errors.__getitem__) and said["down"] == said["up"][::-1]
    assert said["drawn"] == "bear|photograph|true normals" and "25%" in said["clip"] and said["wide"]
    if "left" in said:  # a grey photograph, and normals that face the camera
        assert max(said["left"][:3]) - min(said["left"][:3]) < 8
        assert said["right"][2] > 220 and max(said["right"][:2]) < 180
    assert "pixel" not in said or max(said["pixel"][:3]) < 250  # the surface is drawn in the middle


@pytest.fixture(scope="module")
def evil(runs, tmp_path_factory):
    """A page whose objects have names that a browser could take for commands."""
    folder = shutil.copytree(runs, tmp_path_factory.mktemp("evil") / "runs")
    for method in ("woodham", "trimmed"):
        record = json.loads((folder / method / "diligent" / "ball.json").read_text())
        for i, name in enumerate(EVIL):
            path = folder / method / "diligent" / f"evil{i}"
            shutil.copy(folder / method / "diligent" / "ball.npz", path.with_suffix(".npz"))
            path.with_suffix(".json").write_text(json.dumps(record | {"object": name}))
            truth = folder / "truth" / "diligent" / f"{name}.npz"
            truth.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(folder / "truth" / "diligent" / "ball.npz", truth)
    return write_page(folder, folder / "report.html").read_text()


def test_names_are_text(evil):
    assert "<img" not in evil and evil.count("<script") == 2 and evil.count("</script>") == 2
    data = json.loads(re.search(r'id="data">(.*?)</script>', evil, re.DOTALL)[1])
    assert {o["name"] for o in data["objects"]} == {"ball", "bear", "cat", *EVIL}


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_names_are_text_in_a_browser(evil, tmp_path):
    said = what_it_says(acting(evil, LOOKS), tmp_path / "profile")
    assert said["ready"] == "yes" and "error" not in said
    assert (said["images"], said["scripts"]) == (0, 3)  # the test's own is one of the three
    assert set(EVIL) <= set(said["objects"]) and set(EVIL) <= set(said["heads"])


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_its_screenshot_shows_errors_and_tables(page, tmp_path):
    shown = browser(tmp_path / "profile", "--virtual-time-budget=10000", f"--screenshot={tmp_path / 'shot.png'}")
    subprocess.run([*shown, page.as_uri()], capture_output=True, timeout=120, check=True)
    shot = cv2.imread(str(tmp_path / "shot.png"))
    assert shot.shape[:2] == (1400, 1280)
    assert 0.3 < (shot == 255).all(-1).mean() < 0.97
    ramp = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], cv2.COLORMAP_CIVIDIS)[:, 0].astype(int)
    dark_blue = np.abs(shot[150:640, 40:560].astype(int) - ramp[:60, None, None]).max(-1).min(0) <= 6
    assert dark_blue.mean() > 0.1  # small errors of the ball


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("ABSENT", "--out", "OUT/r.html"), "is no folder"),
        (("RUNS", "--out", "OUT/r.pdf"), "an .html file"),
        (("RUNS", "--out", "OUT/there.html"), "add --overwrite"),
        (("RUNS", "--out", "OUT/r.html", "--objects", "horse"), "no object 'horse'"),
        (("RUNS", "--out", "OUT/r.html", "--methods", "l1"), "no method 'l1'"),
        (("RUNS", "--out", "OUT/no/r.html"), "folder does not exist"),
    ],
)
def test_bad_input_is_one_line(runs, tmp_path, run, arguments, says):
    (tmp_path / "there.html").write_text("mine")
    places = {"RUNS": runs, "ABSENT": tmp_path / "absent"}
    code, _, err = run("report", *(str(places.get(a, a)).replace("OUT", str(tmp_path)) for a in arguments))
    assert code == 2 and says in err and len(err.splitlines()) == 1
    assert (tmp_path / "there.html").read_text() == "mine" and not (tmp_path / "r.html").exists()


def test_the_command_writes_it(runs, tmp_path, run):
    code, out, err = run("report", runs, "--out", tmp_path / "r.html", "--no-surfaces", "--objects", "cat")
    assert (code, err) == (0, "") and out.strip() == str(tmp_path / "r.html")
    assert '"surface":null' in (tmp_path / "r.html").read_text()
