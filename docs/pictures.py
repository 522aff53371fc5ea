"""The pictures of README and of the walks, from rendered captures; needs Chromium with its driver, and matplotlib.

python -m docs.pictures            # all of them, into docs/images
python -m docs.pictures front      # or some: front, tablet, cloth, methods
"""

from __future__ import annotations

import base64
import shlex
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from docs.walks import scenes
from photonormal.cli import main
from photonormal.export import load_normals
from photonormal.export.mesh import display
from photonormal.export.pictures import relit
from photonormal.synth.output import render
from photonormal.synth.recipes import recipe
from tests.browser import Browser

IMAGES = Path(__file__).parent / "images"
WIDTH = 1100  # pixels of a picture of a page


def run(command: str) -> None:
    """One command of photonormal."""
    code = main(shlex.split(command))
    if code:
        raise SystemExit(f"{command}: exit code {code}")


@contextmanager
def page(result: Path, folder: Path, options: str = "", size: tuple[int, int] = (1280, 760)) -> Iterator[Browser]:
    """A result's page as one file, in a window."""
    file = folder / f"{result.name}.html"
    run(f"export {result} --page {file} --overwrite {options}")
    with Browser(folder / "profile", size) as b:
        b.open(file.as_uri())
        yield b


def save(picture: np.ndarray, name: str, width: int = WIDTH) -> None:
    """A picture (h, w, 3) RGB as JPEG, reduced to a width."""
    if picture.shape[1] > width:
        size = (width, round(picture.shape[0] * width / picture.shape[1]))
        picture = cv2.resize(np.ascontiguousarray(picture), size, interpolation=cv2.INTER_AREA)
    bgr = np.ascontiguousarray(picture[..., ::-1])
    cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tofile(IMAGES / name)
    print(IMAGES / name)


def canvas(b: Browser) -> np.ndarray:
    """What the page has drawn, without what lies over it, (h, w, 3) RGB."""
    data = b.run("return document.getElementById('canvas').toDataURL('image/png')").split(",")[1]
    return cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def front(folder: Path) -> None:
    """A rendered bust: photograph, normals, relit, mesh, error."""
    import matplotlib.pyplot as plt

    render(recipe("demo", size=400, crop=400), 1, folder / "bust")
    capture = next(p for p in (folder / "bust").iterdir() if p.is_dir())
    run(f"measure {capture} --out {folder / 'bust-result'}")
    result = folder / "bust-result"
    normals = load_normals(result)
    rows, columns = (np.flatnonzero(normals.mask.any(axis)) for axis in (1, 0))
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    brightest = int(np.argmax(np.loadtxt(capture / "light_directions.txt")[:, 2]))
    name = (capture / "filenames.txt").read_text().split()[brightest]
    photograph = cv2.imread(str(capture / name), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535.0
    coloured = np.rint(127.5 * (normals.map + 1)).astype(np.uint8)
    coloured[~normals.mask] = 255
    error = cv2.imread(str(result / "error.png"))[..., ::-1]
    with page(result, folder, size=(1100, 900)) as b:
        b.click("#ground")
        b.click('[data-value="surface"]')
        b.click('[data-value="matt"]')
        b.settle()
        b.drag((380, 450), (410, 440))
        b.run("document.documentElement.style.setProperty('--ground', '#ffffff'); page.paint()")
        b.settle()
        mesh = canvas(b)
    on = (mesh < 250).any(-1)
    rows, columns = (np.flatnonzero(on.any(axis)) for axis in (1, 0))
    mesh = mesh[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    white = np.quantile(photograph[normals.mask], 0.995)
    panels = {
        "a photograph": display(photograph / white)[box],
        "normals": coloured[box],
        "relit": relit(normals, (0.7, 0.3, 0.5))[box],
        "surface": mesh,
        "error, 0 to 45°": error[box],
    }
    figure, axes = plt.subplots(1, len(panels), figsize=(11, 3.1), layout="constrained")
    for axis, (title, picture) in zip(axes, panels.items(), strict=True):
        axis.imshow(picture)
        axis.set_title(title, fontsize=11)
        axis.axis("off")
    figure.canvas.draw()
    drawn = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    save(drawn, "front.jpg")


def tablet(folder: Path) -> None:
    """Marking the tablet, and its page: raking light beside a photograph, and a profile."""
    scenes.tablet(folder / "tablet")
    run(f"mask {folder / 'tablet'} --out {folder / 'tablet' / 'mask.png'}")
    run(f"measure {folder / 'tablet'} --srgb --out {folder / 'tablet-result'}")
    with page(folder / "tablet-result", folder, "--mm-per-px 0.25") as b:
        b.click('[data-value="raking"]')
        b.run("dome.set([-0.6, 0.5])")
        b.settle()
        save(b.picture(), "walk-tablet-relit.jpg")
        b.choose("#second", "")
        b.click('[data-value="specular"]')
        b.keys("Tab")
        x, y, w, h = b.box("#stage")
        b.click('[data-value="measure"]')
        b.run("page.camera = { x: 0.5, y: 0.32, scale: 2.4 }; page.draw()")
        b.settle()
        b.drag((x + 0.22 * w, y + 0.52 * h), (x + 0.5 * w, y + 0.52 * h), (x + 0.7 * w, y + 0.54 * h))
        b.wait("return document.body.dataset.profile")
        b.run("document.querySelector('aside').scrollTop = 400")
        b.settle()
        save(b.picture(), "walk-tablet-profile.jpg")


def cloth(folder: Path) -> None:
    """What calibrate found on the sphere, and the cloth's surface."""
    scenes.cloth(folder / "cloth", folder / "sphere")
    run(f"calibrate {folder / 'cloth'} --sphere {folder / 'sphere'} --out {folder / 'cloth' / 'lights.lp'}")
    save(cv2.imread(str(folder / "cloth" / "lights_spheres.png"))[..., ::-1], "walk-cloth-sphere.jpg", 560)
    run(f"measure {folder / 'cloth'} --out {folder / 'cloth-result'}")
    with page(folder / "cloth-result", folder) as b:
        b.click('[data-value="surface"]')
        b.run("dome.set([-0.7, 0.45])")
        b.settle()
        b.drag((400, 400), (380, 340))
        b.settle()
        save(b.picture(), "walk-cloth-surface.jpg")


def methods(folder: Path) -> None:
    """The report of sixteen methods on two rendered objects."""
    import os
    import subprocess

    run(f"render objects --count 2 --out {folder / 'objects'}")
    command = [sys.executable, str(Path(__file__).parent / "walks" / "mine.py"), "bench", "diligent"]
    subprocess.run(
        [*command, str(folder / "objects"), "--methods", "all", "--out", str(folder / "runs")],
        env=os.environ,
        check=True,
    )
    run(f"report {folder / 'runs'} --out {folder / 'report.html'}")
    with Browser(folder / "profile-report", (1280, 900)) as b:
        b.call("POST", "/url", {"url": (folder / "report.html").as_uri()})
        b.wait("return document.body.dataset.drawn && document.body.dataset.surface")
        save(b.picture(), "walk-methods-report.jpg")


if __name__ == "__main__":
    made = {f.__name__: f for f in (front, tablet, cloth, methods)}
    with tempfile.TemporaryDirectory() as place:
        for name in sys.argv[1:] or made:
            made[name](Path(place))
