"""Fits as folders for the web: info.json and pictures of the coefficients, for RelightLab and OpenLIME."""

from __future__ import annotations

import json

import numpy as np

from photonormal.disk import FileBatch
from photonormal.progress import progress
from photonormal.relighting import FORMATS, deepzoom
from photonormal.relighting.codes import Codes
from photonormal.relighting.fit import RelightingFit, pieces
from photonormal.types import Capture, InputError, in_pixels

QUALITY = 95  # of JPEG
RIDGE = 3e-4  # of the fit: JPEG leaves larger errors than 8 bits do
LARGEST = 65500  # pixels of a JPEG picture's side, as libjpeg writes it
TEXTURE = 4096  # pixels of a picture's side that every graphics card takes; larger ones become tiles for OpenLIME
PTM = [5, 3, 4, 0, 2, 1]  # 1, u, v, u^2, u v, v^2: their order here, as places in the order of .ptm files
VERSION = "https://cdn.jsdelivr.net/npm/openlime@1/dist"


def write(capture: Capture, kind: str, folder: FileBatch, webp: bool = False) -> None:
    """Fit the photographs, and write the fit of the mask's box; pixels outside the mask are black.

    info.json, and a picture for every three planes: red, green and blue of one coefficient, (code / 255 - bias) scale.
    For OpenLIME index.html, too, and where a side is longer than TEXTURE, tiles instead of whole pictures.

    Parameters
    ----------
    kind : a key of FORMATS that is a folder
    webp : OpenLIME's pictures are lossless WebP, as tiles: it takes whole pictures for JPEG

    Raises
    ------
    InputError
        If the capture's lights are unknown or too few, or a picture would be too large.
    """
    fit = RelightingFit(capture, FORMATS[kind].basis, RIDGE)
    (h, w), k = fit.size, fit.terms
    openlime = kind.startswith("openlime")
    webp = webp and openlime
    tiled = webp or (openlime and max(h, w) > TEXTURE)
    if not tiled and max(h, w) > LARGEST:
        raise InputError(
            f"the pictures would have {w} x {h} pixels but JPEG ends at {LARGEST}; choose --to openlime, which writes "
            "tiles, or measure at a smaller --scale."
        )
    order = PTM if k == len(PTM) else list(range(k))
    with fit.layers() as layers, progress("pictures", k) as advance:
        codes = []
        for j, layer in enumerate(layers[term] for term in order):
            codes.append(Codes.of(C[0] for _, C in pieces([layer])))
            plane = np.empty((h, w, 3), np.uint8)
            for rows, C in pieces([layer]):
                plane[rows] = codes[j](C[0])
            if tiled:
                deepzoom.write(plane, f"plane_{j}", folder, *(("webp", _webp) if webp else ("jpg", jpeg)))
            else:
                folder.write(f"plane_{j}.jpg", jpeg(plane))
            advance()
    step, zero = (np.concatenate([getattr(code, name) for code in codes]) for name in ("step", "zero"))
    about = {
        "width": w,
        "height": h,
        "format": "webp" if webp else "jpg",
        "type": "ptm" if k == len(PTM) else "hsh",
        "colorspace": "rgb",
        "lights": [round(float(v), 5) for v in capture.known_lights().ravel()],
        "nplanes": 3 * k,
        "quality": QUALITY,
        "materials": [{"scale": (255 * step).tolist(), "bias": (zero / 255).tolist()}],
    }
    folder.write("info.json", (json.dumps(about) + "\n").encode())
    if openlime:
        page = PAGE.format(version=VERSION, layout="deepzoom1px" if tiled else "image")
        folder.write("index.html", page.encode())


def jpeg(rgb: np.ndarray) -> bytes:
    """JPEG of (h, w, 3) RGB samples of 8 bits; InputError where a side is longer than LARGEST."""
    import cv2

    if max(rgb.shape) > LARGEST:
        raise InputError(f"the picture has {in_pixels(rgb.shape)} but JPEG ends at {LARGEST} a side; choose a .png.")
    how = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    return cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), how)[1].tobytes()


def _webp(rgb: np.ndarray) -> bytes:
    import cv2

    lossless = [cv2.IMWRITE_WEBP_QUALITY, 101]
    return cv2.imencode(".webp", np.ascontiguousarray(rgb[..., ::-1]), lossless)[1].tobytes()


PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Relightable picture</title>
<link rel="stylesheet" href="{version}/css/skin.css">
<style>
html, body, #view {{ width: 100%; height: 100%; margin: 0; background: black; color: silver; font: 1em sans-serif; }}
</style>
</head>
<body>
<div id="view"></div>
<script src="{version}/js/openlime.min.js"></script>
<script>
const view = document.querySelector("#view");
if (location.protocol === "file:") {{
  view.textContent = "Browsers show this page from a web server alone, such as: python -m http.server";
}} else if (typeof OpenLIME === "undefined") {{
  view.textContent = "OpenLIME, which shows the picture, did not come from {version}. Is there a network?";
}} else {{
  const viewer = new OpenLIME.Viewer("#view", {{ background: "black" }});
  viewer.addLayer("rti", new OpenLIME.Layer({{ type: "rti", url: "info.json", layout: "{layout}" }}));
  new OpenLIME.UIBasic(viewer, {{ skin: "{version}/skin/skin.svg" }});
}}
</script>
</body>
</html>
"""
