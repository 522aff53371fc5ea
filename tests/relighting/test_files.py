"""Files of relightable pictures: what they hold is the least-squares fit, and they show lights that were left out."""

import json
import math
import re
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import scipy.linalg

from photonormal import handover
from photonormal.cli import main
from photonormal.disk import at_once
from photonormal.geometry import fibonacci_hemisphere
from photonormal.masked import box_of
from photonormal.relighting import FORMATS, bases, deepzoom, files, web
from photonormal.relighting.fit import RIDGE, RelightingFit
from photonormal.srgb import from_linear
from photonormal.types import Capture, InputError
from tests.scenes import sphere, write_diligent

KINDS = tuple(FORMATS)
WEB = tuple(kind for kind in KINDS if not FORMATS[kind].ending)


def glossy(lights):
    """A coloured sphere with broad highlights, whose colour changes from left to right."""
    truth = sphere(48)
    N, H = truth.map, lights + np.array([0, 0, 1])
    H = H / np.linalg.norm(H, axis=1, keepdims=True)
    cos = np.maximum(np.einsum("hwc,nc->nhw", N, lights), 0)
    shine = np.maximum(np.einsum("hwc,nc->nhw", N, H), 0) ** 12 * (cos > 0)
    colour = np.stack([np.linspace(0.2, 0.6, 48), np.full(48, 0.4), np.linspace(0.5, 0.3, 48)], -1)
    images = cos[..., None] * colour + 0.2 * shine[..., None]
    return Capture(images.astype(np.float32), truth.mask, lights, truth=truth)


def dome(n):
    lights = fibonacci_hemisphere(n)
    return lights[lights[:, 2] > 0.3]


def read_ptm(path):
    """Scales, biases, codes (h, w, 3, 6), colours (h, w, 3) or 1, by Hewlett-Packard's description."""
    with path.open("rb") as file:
        version, kind, w, h = (file.readline().split()[0].decode() for _ in range(4))
        scale, bias = (np.array(file.readline().split(), float) for _ in range(2))
        body = np.frombuffer(file.read(), np.uint8)
    h, w = int(h), int(w)
    assert version == "PTM_1.2" and len(body) == h * w * (9 if kind == "PTM_FORMAT_LRGB" else 18)
    if kind == "PTM_FORMAT_LRGB":
        codes = np.repeat(body[: 6 * h * w].reshape(h, w, 1, 6), 3, axis=2)
        return scale, bias, codes[::-1], body[6 * h * w :].reshape(h, w, 3)[::-1] / 255
    assert kind == "PTM_FORMAT_RGB"
    return scale, bias, body.reshape(3, h, w, 6).transpose(1, 2, 0, 3)[::-1], 1


def read_picture(path):
    """(h, w, 3) RGB of a whole picture, or of the largest level of a pyramid of tiles."""
    if path.suffix != ".dzi":
        return cv2.imread(str(path))[..., ::-1]
    image = ElementTree.fromstring(path.read_text())
    side, overlap = int(image.get("TileSize")), int(image.get("Overlap"))
    w, h = (int(image[0].get(key)) for key in ("Width", "Height"))
    picture, tiles = np.zeros((h, w, 3), np.uint8), path.with_name(f"{path.stem}_files")
    for tile in (tiles / str(math.ceil(math.log2(max(w, h))))).iterdir():
        x, y = (side * int(number) for number in tile.stem.split("_"))
        top, left = max(y - overlap, 0), max(x - overlap, 0)
        part = cv2.imread(str(tile))[..., ::-1]
        picture[top : top + part.shape[0], left : left + part.shape[1]] = part
    return picture


def shown_by_web(folder, light):
    """As OpenLIME makes it of a folder, by RelightLab's info.json: (code / 255 - bias) scale."""
    told = json.loads((folder / "info.json").read_text())
    k = told["nplanes"] // 3
    x, y = light[:2]
    terms = np.array([1, x, y, x * x, x * y, y * y]) if told["type"] == "ptm" else bases.hsh(np.array([light]), k)[0]
    scale, bias = (np.array(told["materials"][0][key]).reshape(k, 3) for key in ("scale", "bias"))
    ending = "dzi" if list(folder.glob("*.dzi")) else told["format"]
    planes = np.stack([read_picture(folder / f"plane_{j}.{ending}") for j in range(k)])  # (k, h, w, 3)
    assert planes.shape[1:3] == (told["height"], told["width"]) and len(terms) == k
    return np.einsum("khwc,k->hwc", (planes / 255 - bias[:, None, None]) * scale[:, None, None], terms).clip(0, 1)


def written(capture, kind, folder, **how):
    path = folder / f"ball{FORMATS[kind].ending}"
    if path.suffix:
        files.write(capture, kind, path)
    else:
        with at_once(path) as batch:
            web.write(capture, kind, batch, **how)
    return path


def shown_by(path, light):
    """A picture (h, w, 3), white is 1, as a viewer makes it from the file."""
    if path.is_dir():
        return shown_by_web(path, light)
    x, y = light[:2]
    if path.suffix == ".ptm":
        scale, bias, codes, colour = read_ptm(path)
        return ((codes - bias) * scale @ np.array([x * x, y * y, x * y, x, y, 1]) / 255 * colour).clip(0, 1)
    data = path.read_bytes()
    head, kind, size, terms = data.split(b"\r\n", 4)[:4]
    rest = data[len(head + kind + size + terms) + 8 :]
    (w, h, c), (k, rgb, width) = (list(map(int, line.split())) for line in (size, terms))
    assert (head, kind, c, rgb, width) == (b"#HSH1.2", b"3", 3, 2, 1)
    scale, bias = np.frombuffer(rest[: 8 * k], "<f4").reshape(2, k)
    codes = np.frombuffer(rest[8 * k :], np.uint8).reshape(h, w, 3, k)
    return ((codes / 255 * scale + bias) @ bases.hsh(np.array([light]), k)[0]).clip(0, 1)


def test_hemispherical_harmonics_are_orthonormal():
    nodes, weights = np.polynomial.legendre.leggauss(24)
    c, phi = (nodes + 1) / 2, 2 * np.pi * np.arange(24) / 24
    C, P = np.meshgrid(c, phi, indexing="ij")
    L = np.stack([np.sqrt(1 - C**2) * np.cos(P), np.sqrt(1 - C**2) * np.sin(P), C], -1)
    H = bases.hsh(L, 16)
    gram = np.einsum("abi,abj,a->ij", H, H, weights / 2 * 2 * np.pi / 24)
    assert np.abs(gram - np.eye(16)).max() < 1e-9


def coefficients(fit):
    """(k, p, c) of the mask's pixels."""
    with fit.layers() as layers:
        return np.stack([layer[:][fit.capture.mask[box_of(fit.capture.mask)]] for layer in layers])


def reference(B, samples, ridge=RIDGE):
    """argmin |B C - I|^2 + ridge trace(B'B) |C|^2, as least squares of more rows."""
    k = B.shape[1]
    short = np.sqrt(ridge * (B**2).sum()) * np.eye(k)
    return scipy.linalg.lstsq(np.concatenate([B, short]), np.concatenate([samples, np.zeros((k, samples.shape[1]))]))[0]


@pytest.mark.parametrize("kind", KINDS)
def test_the_fit_is_scipys(kind):
    capture = glossy(dome(40))
    basis = FORMATS[kind].basis
    fit = RelightingFit(capture, basis)
    white = fit.white()
    samples = from_linear((capture.images[:, capture.mask] / white).clip(0, 1))  # (n, p, 3)
    wanted = reference(basis(capture.known_lights()), samples.reshape(len(samples), -1))
    assert np.abs(coefficients(fit).reshape(wanted.shape) - wanted).max() < 1e-4


def test_lights_that_differ_from_pixel_to_pixel_are_each_fitted_with_their_own():
    capture = glossy(dome(20))
    p = int(capture.mask.sum())
    bent = capture.known_lights() + np.linspace(0, 0.4, p)[:, None, None] * [1, 0, 0]
    capture = replace(capture, lights_at=(bent / np.linalg.norm(bent, axis=-1, keepdims=True)).astype(np.float32))
    fit = RelightingFit(capture, bases.ptm)
    samples = from_linear((capture.images[:, capture.mask] / fit.white()).clip(0, 1))  # (n, p, 3)
    found = coefficients(fit)
    for pixel in (0, p // 2, p - 1):
        wanted = reference(bases.ptm(capture.lights_at[pixel].astype(float)), samples[:, pixel])
        assert np.abs(found[:, pixel] - wanted).max() < 1e-4


@pytest.mark.parametrize(
    ("kind", "how", "largest", "narrow"),
    [
        *((kind, {}, 99, False) for kind in KINDS),
        ("openlime", {}, 20, False),
        ("openlime-hsh", {"webp": True}, 99, False),
        *((kind, {}, 99, True) for kind in ("ptm", "hsh", "hsh16", "relight")),
    ],
)
def test_lights_that_were_left_out_are_shown_as_the_fit_shows_them(kind, how, largest, narrow, tmp_path, monkeypatch):
    monkeypatch.setattr(web, "TEXTURE", largest)
    monkeypatch.setattr(deepzoom, "SIDE", 14)
    lights = dome(60)
    if narrow:
        lights = dome(300)
        lights = lights[lights[:, 2] > np.cos(np.radians(40))]
    out = np.arange(len(lights)) % 5 == 2
    capture, basis = glossy(lights[~out]), FORMATS[kind].basis
    path = written(capture, kind, tmp_path, **how)
    fit, box, mask = RelightingFit(capture, basis, 1e-9), box_of(capture.mask), capture.mask  # least squares alone
    white = fit.white()
    C = coefficients(fit)
    errors = []
    for light, image in zip(lights[out], glossy(lights).images[out], strict=True):
        truth = from_linear((image[mask] / white).clip(0, 1))
        by_fit = np.einsum("kpc,k->pc", C, basis(light)).clip(0, 1)
        by_file = shown_by(path, light)
        assert by_file[~mask[box]].max() < (0.1 if path.is_dir() else 0.01)  # JPEG rings at the outline
        errors.append([((by_fit - truth) ** 2).mean(), ((by_file[mask[box]] - truth) ** 2).mean()])
    fitted, stored = np.sqrt(np.mean(errors, axis=0))
    assert stored < 1.1 * fitted


@pytest.fixture
def result(tmp_path):
    write_diligent(tmp_path / "ball", glossy(dome(20)))
    assert main(["measure", str(tmp_path / "ball"), "--out", str(tmp_path / "r"), "--method", "woodham"]) == 0
    return tmp_path / "r"


def test_the_command_lists_the_formats_there_are(capsys):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    words = re.findall(r"[\w-]+", capsys.readouterr().out)
    assert set(handover.FORMATS) <= set(words)


def test_a_result_becomes_a_file_or_nothing(result, tmp_path, capsys):
    def refused(*words, says):
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(["export", str(result), *map(str, words)]) == 2
        err = capsys.readouterr().err
        assert says in err and len(err.splitlines()) == 1 and sorted(tmp_path.rglob("*")) == before

    out = tmp_path / "a.ptm"
    assert main(["export", str(result), "--to", "ptm", "--out", str(out)]) == 0
    assert read_ptm(out)[2].shape[2:] == (3, 6)
    refused("--to", "ptm", "--out", out, says="--overwrite")
    refused("--to", "pdf", "--out", out, says="ptm, ptm-rgb, hsh, hsh16, relight")
    refused("--to", "hsh", "--out", tmp_path / "b.ptm", says=".rti")
    refused("--to", "hsh16", "--out", tmp_path / "b.rti", says="at least 16")
    refused("--to", "ptm", says="--out")
    photographs = json.loads((result / "report.json").read_text())["source"]
    (tmp_path / "ball").rename(tmp_path / "away")
    refused("--to", "ptm", "--out", tmp_path / "b.ptm", says=photographs)
    words = ["--to", "ptm", "--out", str(tmp_path / "b.ptm"), "--capture", str(tmp_path / "away")]
    assert main(["export", str(result), *words]) == 0
    assert (tmp_path / "b.ptm").read_bytes() == out.read_bytes()


def test_a_result_becomes_a_folder_for_the_web_or_nothing(result, tmp_path, capsys, monkeypatch):
    def refused(*words, says):
        before = sorted(tmp_path.rglob("*"))
        assert main(["export", str(result), *map(str, words)]) == 2
        err = capsys.readouterr().err
        assert says in err and len(err.splitlines()) == 1 and sorted(tmp_path.rglob("*")) == before

    web_folder, lime = tmp_path / "web", tmp_path / "a lime"
    assert main(["export", str(result), "--to", "relight", "--out", str(web_folder)]) == 0
    assert {p.name for p in web_folder.iterdir()} == {"info.json", *(f"plane_{j}.jpg" for j in range(6))}
    refused("--to", "relight", "--out", web_folder, says="--overwrite")
    assert main(["export", str(result), "--to", "relight", "--out", str(web_folder), "--overwrite"]) == 0
    refused("--to", "relight", "--out", result / "report.json", says="is a file")
    refused("--to", "relight", "--out", tmp_path / "ball", "--overwrite", says="is read here")
    for words in (("--to", "relight", "--webp"), ("--to", "gltf", "--tile"), ("--to", "ptm", "--program", "unreal")):
        refused(*words, "--out", lime, says=f"{words[2]} came without --to")
    capsys.readouterr()
    assert main(["export", str(result), "--to", "openlime-hsh", "--out", str(lime)]) == 0
    assert f"python -m http.server --directory '{lime}'" in capsys.readouterr().err
    assert "info.json" in (lime / "index.html").read_text() and len(list(lime.glob("plane_*.jpg"))) == 9
    monkeypatch.setattr(web, "LARGEST", 20)
    refused("--to", "relight", "--out", tmp_path / "large", says="openlime")


def test_what_viewers_can_not_read_is_refused(result, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(files, "LARGEST", 1000)
    assert main(["export", str(result), "--to", "hsh", "--out", str(tmp_path / "b.rti")]) == 2
    assert "--crop" in capsys.readouterr().err and not (tmp_path / "b.rti").exists()


def test_a_jpeg_ends_where_libjpeg_does():
    widest = np.zeros((1, web.LARGEST, 3), np.uint8)
    assert cv2.imdecode(np.frombuffer(web.jpeg(widest), np.uint8), -1).shape == widest.shape
    with pytest.raises(InputError, match="65501 x 1 pixels"):
        web.jpeg(np.zeros((1, web.LARGEST + 1, 3), np.uint8))
