"""Marking by hand: what is painted and drawn is what the next commands find."""

import base64
import re
import shlex
import time
import zlib

import numpy as np
import pytest

from photonormal.capture import load
from photonormal.geometry import angle_deg
from photonormal.measurement import measure
from photonormal.types import InputError
from photonormal.view.marking import SIDE, MarkedOutline, Marking, Marks
from tests.browser import CHROMIUM, DRIVER, MISSING, Browser
from tests.calibration.chrome import dome, highlight_at, write_pictures
from tests.capture.test_orientation import SHOWN, STORED
from tests.capture.test_orientation import capture as held_upright
from tests.scenes import lambertian, ring, sphere, write_diligent

L = dome(10)
BALL = (400.0, 300.0, 45.0)  # x, y, radius of the mirror sphere
DISC = (170.0, 170.0, 120.0)  # of the object


def photographs(scale=1):
    """A matt bowl and a mirror sphere beside it, on black, under the lights L; 8-bit grey."""
    h, w = 380 * scale, 480 * scale
    y, x = (np.mgrid[:h, :w] + 0.5) / scale - 0.5
    r2 = ((x - DISC[0]) ** 2 + (y - DISC[1]) ** 2) / DISC[2] ** 2
    normal = np.stack([(x - DISC[0]) / DISC[2], (DISC[1] - y) / DISC[2], 2 * np.ones_like(x)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    ball = np.hypot(x - BALL[0], y - BALL[1]) < BALL[2]
    for light in L:
        picture = np.where(r2 < 1, 0.7 * np.maximum(normal @ light, 0), 0.01)
        picture[ball] = 0.04
        sx, sy = highlight_at(light, BALL[:2], BALL[2])
        picture += 2 * np.exp(-((x - sx) ** 2 + (y - sy) ** 2) / 5)
        yield np.rint(255 * picture.clip(0, 1)).astype(np.uint8)


@pytest.fixture
def folder(tmp_path):
    write_pictures(tmp_path / "bowl", photographs())
    return tmp_path / "bowl"


def packed(mask):
    return base64.b64encode(zlib.compress(mask.astype(np.uint8).tobytes())).decode()


def disc(shape, x, y, r):
    b, a = np.mgrid[: shape[0], : shape[1]]
    return np.hypot(a - x, b - y) < r


def test_the_mask_is_suggested_and_found_again(folder):
    marking = Marking(folder)
    assert marking.origin == "found" and (marking.mask ^ disc(marking.shown, *DISC)).mean() < 0.01
    painted = disc(marking.shown, 170, 170, 90)
    assert marking.save(Marks(mask=packed(painted)))["saved"] == ["mask.png"]
    again = Marking(folder)
    assert again.origin == "mask.png" and (again.mask == painted).all()


def test_a_sphere_gives_lights_that_measure_finds(folder):
    marking = Marking(folder)
    seen = marking.sphere(MarkedOutline(*BALL))
    assert angle_deg(np.array(seen["lights"]), L).max() < 1.5 and len(seen["highlights"]) == len(L)
    marks = Marks(mask=packed(disc(marking.shown, *DISC)), left_out=[3], sphere=MarkedOutline(*BALL))
    assert marking.save(marks)["saved"] == ["mask.png", "lights.lp"]
    capture = load(folder)
    assert angle_deg(capture.lights, np.delete(L, 3, axis=0)).max() < 1 and "04.png" not in capture.image_names
    report = measure(load(folder), "woodham").report
    assert report["lights"] == len(L) - 1 and abs(report["pixels"]["mask"] - np.pi * DISC[2] ** 2) < 300
    assert Marking(folder).about()["left_out"] == [3]


def test_a_mask_that_was_drawn_on_what_viewers_show_is_turned_back(tmp_path):
    (tmp_path / "held").mkdir()
    assert (Marking(held_upright(tmp_path / "held", SHOWN[6], 4 * [6])).mask == STORED).all()


def test_the_next_command_can_be_copied(tmp_path):
    write_pictures(tmp_path / "a bowl's", photographs())
    said = Marking(tmp_path / "a bowl's").save(Marks(mask=packed(disc((380, 480), *DISC)), sphere=MarkedOutline(*BALL)))
    assert shlex.split(said["next"])[2] == str(tmp_path / "a bowl's")


def test_large_photographs_are_reduced_and_marks_are_not(tmp_path):
    write_pictures(tmp_path / "large", list(photographs(4))[:5])
    marking = Marking(tmp_path / "large")
    assert marking.step == 2 and max(marking.shown) <= SIDE
    x, y, r = 4 * (BALL[0] + 0.5) - 0.5, 4 * (BALL[1] + 0.5) - 0.5, 4 * BALL[2]
    seen = marking.sphere(MarkedOutline(x, y, r))
    assert angle_deg(np.array(seen["lights"]), L[:5]).max() < 1.5
    with pytest.raises(InputError, match=r"of large at 1/2 of its size"):
        marking.sphere(MarkedOutline(680, 680, 240))  # of the matt bowl
    marking.save(Marks(mask=packed(disc(marking.shown, 300, 300, 200)), sphere=MarkedOutline(x, y, r)))
    capture = load(tmp_path / "large")
    assert (capture.mask ^ disc(capture.mask.shape, 600.5, 600.5, 400)).sum() < 2000
    assert angle_deg(capture.lights, L[:5]).max() < 1


def test_a_crop_is_what_is_measured(folder):
    marks = Marks(crop=(100, 50, 300, 250), sphere=MarkedOutline(*BALL))
    assert Marking(folder).save(marks)["saved"] == ["crop.txt", "lights.lp"]
    capture = load(folder)
    assert capture.mask.shape == (200, 200) and capture.mask.all()
    assert capture.crop is not None and (capture.crop.x, capture.crop.y) == (100, 50)
    again = Marking(folder)
    assert again.about()["crop"] == [100, 50, 300, 250]
    assert again.save(Marks(mask=packed(disc(again.shown, *DISC)))) == {"exist": ["crop.txt"]}
    again.save(Marks(mask=packed(disc(again.shown, *DISC)), overwrite=True))
    assert load(folder).mask.shape == (380, 480) and again.about()["crop"] is None


def test_nothing_is_replaced_unasked(folder):
    write_pictures(folder, [], mask=np.ones((380, 480), bool))
    (folder / "lights.lp").write_text("mine")
    marking, marks = Marking(folder), Marks(mask=packed(disc((380, 480), *DISC)), sphere=MarkedOutline(*BALL))
    before = (folder / "mask.png").read_bytes()
    assert marking.save(marks) == {"exist": ["mask.png", "lights.lp"]}
    assert (folder / "mask.png").read_bytes() == before and (folder / "lights.lp").read_text() == "mine"
    marks.overwrite = True
    assert marking.save(marks)["saved"] == ["mask.png", "lights.lp"] and len(load(folder).lights) == len(L)


@pytest.mark.parametrize(
    ("marks", "says"),
    [
        (Marks(), "nothing was marked"),
        (Marks(left_out=list(range(8))), "2 pictures are left"),
        (Marks(mask=packed(np.zeros((380, 480)))), "the mask is empty"),
        (Marks(mask="AAAA"), "in part only"),
        (Marks(mask=packed(disc((380, 480), *DISC)), crop=(0, 0, 20, 20)), "shows nothing"),
        (Marks(crop=(20, 0, 10, 20)), "outside"),
        (Marks(left_out=[0]), "the light of 02.png is not known"),
        (Marks(sphere=MarkedOutline(170, 170, 60)), "highlight"),
        (Marks(sphere=MarkedOutline(9000, 170, 60)), "outside"),
    ],
)
def test_what_makes_no_sense_is_told_and_nothing_is_written(folder, marks, says):
    before = sorted(p.name for p in folder.iterdir())
    with pytest.raises(InputError, match=says):
        Marking(folder).save(marks)
    assert sorted(p.name for p in folder.iterdir()) == before


def test_lights_of_another_layout_are_not_hidden(tmp_path):
    write_diligent(tmp_path / "ballPNG", lambertian(sphere(40), ring(7)))
    with pytest.raises(InputError, match="--images"):
        Marking(tmp_path / "ballPNG").save(Marks(left_out=[1]))


def test_a_folder_of_neither_kind_is_refused(tmp_path, run):
    (tmp_path / "empty").mkdir()
    for given, says in ((tmp_path / "empty", "holds no pictures"), (tmp_path / "absent", "is no folder")):
        code, _, err = run("view", given, "--no-browser")
        assert code == 2 and says in err and len(err.splitlines()) == 1


@pytest.fixture
def marked(served, folder, tmp_path):
    """The page of the bowl at a desk."""
    if CHROMIUM is None or DRIVER is None:
        pytest.skip(MISSING)
    with Browser(tmp_path / "profile", (1440, 900)) as b:
        b.open(served(folder))
        yield b


def place(b, x, y):
    """Where a pixel of the photographs is in the window."""
    fx, fy, scale = b.run("return [mark.frame.x, mark.frame.y, mark.frame.scale]")
    sx, sy, _, _ = b.box("#stage")
    return sx + fx + (x + 0.5) * scale, sy + fy + (y + 0.5) * scale


def test_by_pointer(marked, folder):
    b = marked
    b.click('button[data-tool="erase"]')
    b.drag(place(b, 170, 170), place(b, 170, 60))
    b.click('button[data-tool="sphere"]')
    b.drag(place(b, 380, 290), place(b, 380 + BALL[2], 290))
    b.wait("return document.body.dataset.lights")
    b.drag(place(b, 380, 290), place(b, *BALL[:2]))  # the circle follows
    found = b.wait("const l = JSON.parse(document.body.dataset.lights || 'null'); return l && mark.sphere.x > 395 && l")
    b.settle()
    found = b.wait("return mark.found && mark.found.lights")
    assert angle_deg(np.array(found), L).max() < 6  # a hand is off by a pixel or two
    b.click("#after")
    b.click("#used")
    b.click("#save")
    assert b.wait("return document.body.dataset.saved") == "mask.png lights.lp"
    assert f"photonormal measure {folder}" in b.text("#done-next") and b.errors() == []
    capture = load(folder)
    assert len(capture.lights) == len(L) - 1 and "02.png" not in capture.image_names
    assert not capture.mask[100, 170] and capture.mask[170, 100]
    b.run("document.getElementById('done').close()")
    b.click("#save")
    b.wait("return document.getElementById('asked').open")
    assert "mask.png" in b.text("#asked-said")


def test_by_keys_alone(marked, folder):
    b = marked
    for _ in range(30):
        b.keys("Tab")
        if b.run("return document.activeElement.id") == "stage":
            break
    b.keys("e", "]", "]", "Enter", "Left", "Left", "Left", "Enter")
    before = b.run("return brush.inside().reduce((a, v) => a + v, 0)")
    b.keys("z", "b", " ")
    assert b.run("return brush.inside().reduce((a, v) => a + v, 0)") > before
    b.keys("o", *["Right"] * 10, *["Down"] * 10)
    b.keys(*["Right"] * 18, *["Down"] * 12, shift=True)
    b.keys(*["["] * 18)
    x, y, r = b.run("return [mark.sphere.x, mark.sphere.y, mark.sphere.r]")
    assert abs(x - BALL[0]) < 8 and abs(y - BALL[1]) < 8 and abs(r - BALL[2]) < 3
    b.keys(".", "x", "c", "Enter")
    b.keys("Left", "Up", shift=True)
    b.keys("Enter")
    crop = b.run("return mark.cropped()")
    assert crop[2] - crop[0] == 8 and b.run("return [...mark.left_out]") == [1]
    for _ in range(40):
        b.keys("Tab")
        if b.run("return document.activeElement.id") == "save":
            break
    b.keys("Enter")
    assert "mask.png" in b.wait("return document.body.dataset.saved")


def test_a_stroke_lies_where_the_brush_is(marked):
    inside = marked.run(
        "brush.fill(() => 0); brush.stroke([100, 80], [100, 80], 21, true); const w = brush.canvas.width, found = [];"
        "brush.inside().forEach((v, i) => v && found.push([i % w, Math.floor(i / w)])); return found"
    )
    finest = "at('brush').value = 1; brush.fill(() => 0); brush.stroke([9.5, 9.5], [9.5, 9.5], mark.width(), true);"
    assert marked.run(f"{finest} return brush.inside().some(Boolean)")
    assert np.allclose(np.mean(inside, axis=0), [100, 80], atol=0.05) and abs(len(inside) - np.pi * 10.5**2) < 12


def test_what_comes_late_is_not_shown(marked):
    b = marked
    b.run("""
        const real = fetch;
        window.fetch = async (path, what) => {
            const answer = await real(path, what);
            if (path !== "picture/2") await new Promise((done) => setTimeout(done, 500));
            return answer;
        };
        mark.sphere = { x: 400, y: 300, r: 45 };
        mark.look(0);
        mark.show(1);
        mark.show(2).then(() => { window.second = mark.photograph; });
        setTimeout(() => document.getElementById("unsphere").click(), 100);""")
    b.wait("return window.second")
    time.sleep(1)
    assert b.run("return mark.photograph === window.second && mark.found === null")


def test_on_a_phone(served, folder, tmp_path):
    if CHROMIUM is None or DRIVER is None:
        pytest.skip(MISSING)
    with Browser(tmp_path / "profile", (390, 844), phone=True) as b:
        b.open(served(folder))
        assert b.run("return document.documentElement.scrollWidth") <= 390
        b.click('button[data-tool="erase"]')
        before = b.run("return brush.inside().reduce((a, v) => a + v, 0)")
        b.drag(place(b, 170, 170), place(b, 170, 60), kind="touch")
        assert b.run("return brush.inside().reduce((a, v) => a + v, 0)") < before
        assert b.errors() == []


def test_the_page_asks_for_nothing_else(served, folder):
    address = served(folder)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{20,}/", address)
