"""The page in a browser: what a person sees and does, by pointer, by finger and by keys alone."""

import json
import re
import shutil
import time

import numpy as np
import pytest

from photonormal.types import Normals
from photonormal.view import show
from photonormal.view.page import read
from tests.browser import CHROMIUM, DRIVER, MISSING, Browser
from tests.view.conftest import relief, write_result

pytestmark = pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason=MISSING)


@pytest.fixture(scope="module")
def desk(served, result, tmp_path_factory):
    """A desk's window with one result."""
    with Browser(tmp_path_factory.mktemp("profile"), (1440, 900)) as b:
        b.address = served(result)
        yield b


@pytest.fixture
def window(desk):
    desk.open(desk.address)
    return desk


def middle(b):
    x, y, w, h = b.box("#stage")
    return x + w / 2, y + h / 2


def around(b, dx=0, dy=0, size=12):
    """What the window shows near the middle of the picture: the mean colour."""
    x, y = middle(b)
    scale = b.run("return devicePixelRatio")
    x, y = int(scale * (x + dx)), int(scale * (y + dy))
    return b.picture()[y - size : y + size, x - size : x + size].reshape(-1, 3).mean(0)


def test_the_light_follows_the_pointer_and_is_held(window):
    b = window
    b.choose("#second", "")
    b.click('[data-value="matt"]')
    x, y = middle(b)
    b.drag((x, y), (x - 280, y), press=False)
    left, right = around(b, -150), around(b, 150)
    assert left.mean() > right.mean() + 60
    b.drag((x + 280, y), (x + 280, y))
    assert "held" in b.text("#hint") and around(b, 150).mean() > around(b, -150).mean() + 60
    b.drag((x, y), (x - 280, y), press=False)
    assert around(b, 150).mean() > around(b, -150).mean() + 60


def test_the_light_is_dragged_on_its_hemisphere(window):
    b = window
    b.choose("#second", "")
    x, y, w, h = b.box("#dome")
    b.drag((x + w / 2, y + h / 2), (x + w / 2, y + 0.12 * h))
    assert b.run("return document.getElementById('azimuth').value") == "90"
    assert around(b, 0, -200).mean() > around(b, 0, 200).mean() + 60


def test_every_way_to_light_looks_different(window):
    b = window
    b.choose("#second", "")
    seen = []
    for mode in ("lambert", "gloss", "matt", "specular", "raking"):
        b.click(f'[data-value="{mode}"]')
        b.settle()
        seen.append(b.picture()[100:800, 100:1000].astype(int))
    for i in range(5):
        for j in range(i):
            assert np.abs(seen[i] - seen[j]).max() > 20, (i, j)


def test_the_border_shows_two_layers_and_moves(window):
    b = window
    b.choose("#second", "normals")
    b.choose("#first", "albedo")
    b.settle()
    blue = around(b, -60)
    assert blue[2] > 1.3 * blue[0]
    x, y, w, h = b.box("#border")
    b.drag((x + w / 2, y + h / 2), (x + w / 2 - 200, y + h / 2))
    grey = around(b, -60)
    assert abs(grey[2] - grey[0]) < 12
    assert [s for s in b.run("return [...document.querySelectorAll('#labels span')].map((s) => s.textContent)")] == [
        "Normals",
        "Albedo",
    ]


def test_photographs_change_with_the_light(window):
    b, names = window, set()
    b.choose("#first", "photograph")
    b.choose("#second", "")
    x, y = middle(b)
    for dx in (-250, 250):
        b.drag((x, y), (x + dx, y), press=False)
        b.settle()
        names.add(b.text("#labels"))
    assert len(names) == 2 and all(n.startswith("Photograph ") for n in names)


@pytest.mark.parametrize("layer", ["expected", "error"])
def test_errors_have_a_scale_in_degrees(window, layer):
    b = window
    b.choose("#first", layer)
    b.run("const e = document.getElementById('limit'); e.value = 10; e.dispatchEvent(new Event('input'));")
    b.settle()
    assert "10° and more" in b.text("#legend")
    colour = around(b, 60)
    assert colour[2] > colour[0]  # small errors are dark blue


def test_values_under_the_pointer(window):
    b = window
    b.choose("#second", "")
    b.click('[data-value="move"]')
    b.drag(middle(b), tuple(v + 1 for v in middle(b)), press=False)
    text = b.wait("return document.getElementById('values').textContent")
    assert re.search(r"Normal-?0\.0\d\d, -?0\.0\d\d, (0\.99\d|1\.000)", text)
    assert "Height" in text and "True error0.0°" in text
    assert b.run("return [angle(5), angle(254)]") == ["1.3°", "63.5° or more"]
    red, green, blue = (int(v) for v in re.search(r"Albedoabout (\d+), (\d+), (\d+)", text).groups())
    assert red == green == blue > 240  # evenly white, over its own brightest part


def test_a_line_tells_the_sphere_s_height(window, result):
    b = window
    b.click('[data-value="measure"]')
    x, y = middle(b)
    radius = 0.45 * 96  # of the sphere in pixels
    scale = b.run("const s = document.getElementById('stage'); return [s.clientWidth, s.clientHeight]")
    per_pixel = 0.92 * min(scale[0] / 97, scale[1] / 97)
    b.drag((x - 0.9 * radius * per_pixel, y), (x, y), (x + 0.9 * radius * per_pixel, y))
    said = b.wait("return document.body.dataset.profile")
    length, range_, _ = (float(v) for v in re.findall(r"(-?[\d.]+) px", said))
    assert abs(length - 1.8 * radius) < 3 and abs(range_ - radius * (1 - (1 - 0.81) ** 0.5)) < 0.08 * radius
    b.click("#clear")
    assert not b.run("return document.getElementById('profile').checkVisibility()")


@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (1, 1)])
def test_the_surface_of_one_row_is_seen(desk, tmp_path, shape):
    normals = Normals(np.broadcast_to(np.float32([0, 0, 1]), (*shape, 3)), np.ones(shape, bool))
    heights = np.arange(40.0)[: shape[0] * shape[1]].reshape(shape) / 8
    path, _ = show.export_page(write_result(tmp_path / "thin", heights, normals), tmp_path / "page.html")
    desk.open(path.as_uri())
    desk.click('[data-value="surface"]')
    desk.settle()
    desk.wait("return page.panes[0].surface?.count > 0")
    desk.settle()
    shown = desk.picture()[100:800, 100:1000].astype(int)
    assert (np.abs(shown - shown[0, 0]).max(-1) > 40).sum() > 300 and desk.errors() == []


def test_the_surface_turns_and_is_measured(window):
    b = window
    b.click('[data-value="surface"]')
    b.settle()
    picked = b.run(
        "const { surface: s, pane } = page.panes[0];"
        "return [[60, 40], [30, 50], [48, 75]].map(([x, y]) => s.pick(...s.project(x, y, pane), pane))"
    )
    assert picked == [[60, 40], [30, 50], [48, 75]]
    before = b.picture()[100:800, 100:1000].astype(int)
    assert (np.abs(before - before[0, 0]).max(-1) > 30).mean() > 0.15
    x, y = middle(b)
    b.drag((x, y), (x + 120, y + 20))
    b.settle()
    assert (np.abs(b.picture()[100:800, 100:1000] - before).max(-1) > 20).mean() > 0.05
    b.click('[data-value="measure"]')
    for dx in (-60, 60):
        b.drag((x + dx, y), (x + dx, y))
    assert "Length" in b.wait("return document.body.dataset.profile")


def test_all_of_it_by_keys_alone(window):
    b = window
    state = "return [...document.querySelectorAll('[aria-pressed=true]')].map((e) => e.textContent)"
    for _ in range(30):
        b.keys("Tab")
        if b.run("return document.activeElement.id") == "stage":
            break
    else:
        raise AssertionError("Tab never reaches the picture")
    azimuth = b.run("return document.getElementById('azimuth').value")
    b.keys("Right", "Right", "Right")
    assert b.run("return document.getElementById('azimuth').value") != azimuth
    b.keys("3")
    assert "Shape only" in b.run(state)
    b.keys("+", "+", "m", "Left", "0", "]")
    b.wait("return document.getElementById('border').ariaValueNow === '52'")
    assert "Move" in b.run(state)
    b.keys("d", "Left")
    b.keys("Left", "Left", shift=True)
    b.keys("Enter")
    b.keys(*["Right"] * 4, shift=True)
    b.keys("Enter")
    assert "Length" in b.wait("return document.body.dataset.profile")
    assert "Normal" in b.wait("return document.getElementById('values').textContent")
    b.keys("Escape", "s", "Left", "Up")
    b.settle()
    assert "Surface" in b.run(state)
    b.keys("p", "Tab")
    assert b.run("return document.activeElement.id") == "border"
    b.keys("Left")
    b.wait("return document.getElementById('border').ariaValueNow === '50'")
    for _ in range(8):
        b.keys("Tab")
        if b.run("return document.activeElement.id") == "dome":
            break
    b.keys("Up")
    assert b.run("return document.activeElement.id") == "dome"


def test_the_ground_is_dark_or_light(window):
    b = window
    dark = b.picture()[400, 20]
    b.click("#ground")
    b.settle()
    assert b.picture()[400, 20].mean() > 200 > 60 > dark.mean()


def test_nothing_went_wrong(window):
    assert window.errors() == [] and window.run("return document.body.dataset.error || ''") == ""


def test_a_phone(served, result, tmp_path):
    with Browser(tmp_path / "profile", (390, 844), phone=True) as b:
        b.open(served(result))
        assert b.run("return document.documentElement.scrollWidth") <= 390
        small = b.run(
            "return [...document.querySelectorAll('button')].filter((e) => e.checkVisibility() && "
            "e.getBoundingClientRect().height < 36).map((e) => e.textContent)"
        )
        assert small == []
        b.choose("#second", "")
        x, y = middle(b)
        b.drag((x, y), (x - 150, y), kind="touch")
        assert around(b, -80).mean() > around(b, 80).mean() + 40
        before = b.picture()
        b.pinch((x, y), 30, 90)
        b.settle()
        assert np.abs(before[300:900].astype(int) - b.picture()[300:900]).mean() > 3
        assert b.errors() == []


def test_two_results_side_by_side(served, result, other, tmp_path):
    with Browser(tmp_path / "profile", (1440, 900)) as b:
        b.open(served(result, other))
        assert "woodham" in b.text("#title") and "trimmed" in b.text("#title")
        b.choose("#second", "")
        x, y, w, h = b.box("#stage")
        b.drag((x + w / 4, y + h / 2), (x + w / 4 - 150, y + h / 2), press=False)
        b.settle()
        shot = b.picture().astype(int)
        left, right = (
            shot[int(y) : int(y + h - 60), int(x + k * w / 2) + 2 : int(x + (k + 1) * w / 2) - 2] for k in (0, 1)
        )
        n = min(left.shape[1], right.shape[1])
        assert np.abs(left[60:, :n] - right[60:, :n]).max(-1).mean() < 6  # the same sphere under the same light
        b.choose("#pane-1", "")
        assert "trimmed" not in b.text("#title")


def test_what_was_measured_goes_with_its_result(desk, served, result, other):
    b = desk
    b.open(served(result, other))
    b.click('[data-value="measure"]')
    x, y, w, h = b.box("#stage")
    right = x + 0.75 * w, y + h / 2
    b.drag((right[0] - 60, right[1]), right, (right[0] + 60, right[1]))
    b.wait("return document.body.dataset.profile")
    b.choose("#pane-1", "")
    b.settle()
    assert not b.run("return document.getElementById('profile').checkVisibility()")
    b.run("document.getElementById('stage').focus()")
    b.keys("Left")
    assert "Normal" in b.wait("return document.getElementById('values').textContent")
    assert b.run("return document.body.dataset.error || ''") == ""


def test_photographs_are_asked_for_once_the_light_rests(desk, served, result, other):
    b = desk
    b.open(served(result, other))
    b.run(
        "performance.clearResourceTimings();"
        "for (let a = 0; a < 6; a += 0.3) dome.set([0.7 * Math.cos(a), 0.7 * Math.sin(a)]);"
    )
    time.sleep(0.3)
    b.settle()
    asked = b.run("return performance.getEntriesByType('resource').map((e) => e.name)")
    assert len([name for name in asked if "/photograph-" in name]) == 2  # one for each result


def test_without_depth_a_line_has_a_length(desk, served, result, tmp_path):
    folder = shutil.copytree(result, tmp_path / "flat")
    (folder / "depth.npz").unlink()
    b = desk
    b.open(served(folder))
    b.click('[data-value="measure"]')
    x, y = middle(b)
    b.drag((x - 100, y), (x, y), (x + 100, y))
    assert re.fullmatch(r"Length [\d.]+ px. This result has no depth.", b.wait("return document.body.dataset.profile"))


def test_small_lengths_are_no_zeros(desk, served, tmp_path):
    folder = write_result(tmp_path / "coin", *relief(200, 300), mm_per_px=0.001 / 3)
    b = desk
    b.open(served(folder))
    assert "0.0003333 mm a pixel" in b.text("#facts")
    b.click('[data-value="measure"]')
    x, y = middle(b)
    b.drag((x - 300, y), (x, y), (x + 300, y))
    length, range_ = (float(v) for v in re.findall(r"([\d.]+) mm", b.wait("return document.body.dataset.profile"))[:2])
    assert 0.02 < length < 0.1 and 0.003 < range_ < 0.006  # two of 12 cos(100 / 45) pixels, nearly
    assert b.run("return document.querySelector('#chart text').textContent") == f"{range_:.4f}"


def test_a_photograph_that_is_gone_is_named(desk, served, result, capture, tmp_path):
    shutil.copytree(capture, tmp_path / "moved")
    address = served(result, "--capture", tmp_path / "moved")
    b = desk
    for path in (tmp_path / "moved").glob("0*.png"):
        path.unlink()
    b.open(address)
    assert "is missing" in b.text("#trouble")


def test_when_the_browser_takes_the_memory_away_it_is_said(window):
    window.run("page.gl.getExtension('WEBGL_lose_context').loseContext()")
    window.wait("return !document.getElementById('trouble').hidden")
    assert "Reload" in window.text("#trouble")


def test_buttons_on_the_picture_have_their_keys(window):
    b = window
    b.run("document.getElementById('larger').focus()")
    b.keys("Enter", " ")
    assert b.run("return page.camera.scale > 1.5 && !page.held")


def test_only_the_main_button_acts(window):
    window.drag(middle(window), button=2)
    assert not window.run("return page.held")


def test_a_screen_of_more_tiles_than_are_kept_comes_to_rest(desk, tmp_path, monkeypatch):
    monkeypatch.setattr(show, "read", lambda name: read(name).replace("KEPT = 220", "KEPT = 6"))
    folder = write_result(tmp_path / "relief", *relief(1030, 1030))
    path, _ = show.export_page(folder, tmp_path / "page.html")
    b = desk
    b.open(path.as_uri())
    b.choose("#second", "")
    b.settle()
    loads = b.run(
        "const load = page.tiles.load; window.loads = 0; page.tiles.load = function (...all) {"
        "window.loads++; return load.apply(this, all); }; page.draw(); return page.tiles.kept.size"
    )
    time.sleep(1)
    assert loads > 6 and b.run("return window.loads") == 0


def test_names_are_shown_as_text(served, result, tmp_path):
    folder = write_result(tmp_path / "x", *relief(40, 50))
    name = "</script><img src=x onerror=alert(1)>/* data */ & <b>"
    report = json.loads((folder / "report.json").read_text())
    (folder / "report.json").write_text(json.dumps(report | {"capture": name}))
    with Browser(tmp_path / "profile") as b:
        b.open(served(folder))
        assert name in b.text("#title") and b.run("return document.images.length") == 0 and b.errors() == []


def test_without_webgl_the_page_says_so_and_shows_pictures(served, result, tmp_path):
    with Browser(tmp_path / "profile", arguments=["--disable-3d-apis"]) as b:
        b.open(served(result))
        b.wait("return document.body.dataset.plain")
        assert (
            "WebGL 2" in b.text("#trouble") and b.run("return document.querySelectorAll('#plain canvas').length") == 4
        )
        assert b.run(  # they are scrolled, and nothing lies over them
            "const e = new WheelEvent('wheel', { bubbles: true, cancelable: true, deltaY: 50 });"
            "return document.querySelector('#plain canvas').dispatchEvent(e)"
        )
        assert not b.run("return document.getElementById('border').checkVisibility()")


@pytest.mark.slow
def test_24_megapixels(served, large, tmp_path):
    with Browser(tmp_path / "profile") as b:
        b.open(served(large))
        b.choose("#second", "")
        b.run("document.getElementById('stage').focus()")
        b.keys(*["+"] * 14)
        b.settle()
        levels = b.run("return performance.getEntriesByType('resource').map((e) => e.name)")
        full = [name for name in levels if "/normals/0/" in name]
        assert 0 < len(full) < 48  # the full size where it is looked at closely, and not all of its 96 tiles
        b.keys("0", "d")
        x, y = middle(b)
        b.drag((x - 300, y), (x, y), (x + 300, y))
        said = b.wait("return document.body.dataset.profile")
        assert "mm" in said and b.errors() == []
