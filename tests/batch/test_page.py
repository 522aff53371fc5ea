"""The page of a batch, in a browser."""

import pytest

from photonormal.batch.page import page
from photonormal.batch.row import CaptureRow
from tests.browser import CHROMIUM, DRIVER, MISSING, Browser

EVIL = "<img src=x onerror=attacked()>"
ROWS = [
    CaptureRow("b", "failed", failure=f"{EVIL} is truncated"),
    CaptureRow(
        EVIL, "done", "", 900, 12, 3.5, None, 0, 1, f"{EVIL} is dark", 1.5, 300.0, "woodham", page=f"{EVIL}/view.html"
    ),
    CaptureRow("a 10", "done", "", 1000, 9, 11.0, 2.0, 1, 2, "lights are turned", 0.5, 310.0, "woodham"),
    CaptureRow("a 9", "done", "", 100, 9, 1.0, 2.0, 0, 0, "", 2.5, 310.0, "woodham"),
    CaptureRow("z", "not begun"),
]
SHOWN = "return [...document.querySelectorAll('tbody tr:not([hidden]) th > a')].map((a) => a.textContent)"


@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason=MISSING)
def test_rows_are_sorted_and_filtered_and_names_stay_text(tmp_path):
    (tmp_path / "index.html").write_bytes(page(ROWS, "season"))
    with Browser(tmp_path / "profile") as browser:
        browser.open((tmp_path / "index.html").as_uri())
        assert browser.run(SHOWN) == ["b", EVIL, "a 10", "a 9", "z"]
        assert browser.run("return document.images.length") == 3  # one for each result
        browser.click("thead th:nth-child(3) button")
        assert browser.run(SHOWN)[:3] == ["a 9", EVIL, "a 10"]
        for kind, names in (("grave", ["a 10"]), ("note", [EVIL]), ("fine", ["a 9"]), ("failed", ["b"])):
            browser.click(f".choice button[data-kind={kind}]")
            assert browser.run(SHOWN) == names
        browser.click('.choice button[data-kind=""]')
        browser.click("#find")
        browser.keys(*"TURNED")
        assert browser.run(SHOWN) == ["a 10"]
        assert "1 failed" in browser.text("#failures") and EVIL in browser.text("#failures")
        assert browser.run("return document.querySelector('tbody tr:not([hidden]) img').getAttribute('src')") == (
            "a%2010/thumbnail.png"
        )


def test_what_failed_is_told_on_top_and_nothing_where_nothing_did():
    text = page(ROWS, "season").decode()
    assert text.index("1 failed</h2>") < text.index("<table>") and "attacked()>" not in text
    assert 'id="failures"' not in page(ROWS[1:], "season").decode()


def test_a_name_may_look_like_a_place_of_the_page():
    text = page(ROWS[2:3], "[[count]]").decode()
    assert "<h1>[[count]]</h1>" in text and "<p>1 capture</p>" in text


def test_a_row_opens_the_page_of_its_result_or_its_picture():
    text = page(ROWS, "season").decode()
    assert 'href="%3Cimg%20src%3Dx%20onerror%3Dattacked%28%29%3E/view.html"' in text
    assert 'href="a%209/preview.png"' in text and 'href="z/"' in text
