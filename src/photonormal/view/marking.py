"""Marking photographs by hand: the mask, a sphere's outline, pictures to leave out, a crop."""

from __future__ import annotations

import base64
import shlex
import zlib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from photonormal.calibration.circle import Circle
from photonormal.calibration.mask import mask_from_shading
from photonormal.calibration.sphere import Sphere, look_at_spheres
from photonormal.calibration.survey import Photograph
from photonormal.capture import CROP, load, own_crop
from photonormal.capture.images import ImageFiles, read_mask
from photonormal.capture.orientation import read_drawn
from photonormal.capture.pictures import evenly, find_mask
from photonormal.crop import Crop
from photonormal.disk import at_once
from photonormal.export import lights as text
from photonormal.export.mesh import display
from photonormal.masked import means
from photonormal.options import Coordinate, Positive, Whole
from photonormal.png import encode_mask
from photonormal.progress import progress
from photonormal.rig.mask import MASK_PICTURES
from photonormal.rig.pictures import images_of, numbered_pictures
from photonormal.types import InputError
from photonormal.view.planes import as_webp, exact

SIDE = 1600  # pixels of the longest side on the page; larger photographs are reduced by a whole number


class MarkedOutline(msgspec.Struct):
    """A sphere's outline in pixels of the photographs; found by itself without."""

    x: Coordinate
    y: Coordinate
    r: Positive


class Marks(msgspec.Struct):
    """What a person marked.

    Parameters
    ----------
    mask : bytes of the page's mask (rows, columns of `Marking.shown`), 1 on the object, deflated, in base64; None: none
    crop : x0, y0, x1, y1 in pixels of the photographs: what of them is measured. None: all, and a saved crop goes
    left_out : indices of pictures
    sphere : whose highlights give the lights
    overwrite : replace files that exist
    """

    mask: str | None = None
    crop: tuple[Whole, Whole, Whole, Whole] | None = None
    left_out: list[Whole] = []
    sphere: MarkedOutline | None = None
    overwrite: bool = False


class Marking:
    """The photographs of a folder, reduced for the page, and what is suggested for them."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.paths = numbered_pictures(folder)
        self.names = [p.name for p in self.paths]
        self.images = ImageFiles(self.paths, None, np.ones((len(self.paths), 1)))
        h, w = self.images.shape[1:3]
        self.step = -(-max(h, w) // SIDE)
        self.white = max(float(self.images[0].max()), 1e-9) if self.images.dtype.kind == "f" else 1.0
        with progress(f"reading {len(self.paths)} photographs"):
            self.grey = images_of(self.images, lambda image: means(image.mean(-1), self.step).astype(np.float16))
        self.shown = self.grey[0].shape  # (rows, columns) on the page
        self.mask, self.origin = self._suggested()
        self.lights = self._given_lights()

    def about(self) -> dict[str, Any]:
        """What the page gets, values of JSON."""
        h, w = self.images.shape[1:3]
        return {
            "title": self.folder.resolve().name,
            "names": self.names,
            "width": w,
            "height": h,
            "shown": [self.shown[1], self.shown[0]],
            "step": self.step,
            "mask": self.origin,
            "crop": self._saved_crop(),
            "left_out": [j for j, name in enumerate(self.names) if self.lights and name not in self.lights],
        }

    def picture(self, j: int) -> bytes:
        """Photograph j as WebP."""
        level = means(self.images[j] / self.white, self.step)
        scale = max(float(np.quantile(level, 0.995)), 1e-6)
        return as_webp(display(np.broadcast_to(level / scale, (*self.shown, 3))))

    def mask_bytes(self) -> bytes:
        """The suggested mask, (rows, columns) of `shown`, 1 on the object, as the page's tiles are."""
        return exact(self.mask.astype(np.uint8)[..., None])

    def sphere(self, outline: MarkedOutline | None) -> dict[str, Any]:
        """The sphere there, or the one that is found, with its highlights and lights, in pixels of the photographs."""
        s, h = self.step, self.images.shape[1:3]
        given = [] if outline is None else [_moved(Circle(outline.x, outline.y, outline.r), 1 / s)]
        found = self._look(given, lambda j: self.grey[j].astype(np.float32)[..., None] / self.white, self.shown)
        circle = _moved(found.circle, s)
        return {
            "circle": {"x": circle.x, "y": circle.y, "r": circle.r, "confidence": found.circle.confidence},
            "highlights": [p and [s * (p.x + 0.5) - 0.5, s * (p.y + 0.5) - 0.5] for p in found.highlights],
            "lights": [l.tolist() if np.isfinite(l).all() else None for l in found.L.round(5)],
            "doubts": found.doubts(self.names),
            "frame": list(h),
        }

    def save(self, marks: Marks) -> dict[str, Any]:
        """Write what was marked into the folder, all files at once; names those that exist unless `overwrite`."""
        kept = [j for j in range(len(self.names)) if j not in set(marks.left_out)]
        if len(kept) < 3:
            raise InputError(f"{len(kept)} pictures are left but normals need at least 3; leave fewer out.")
        content: dict[str, bytes] = {}
        crop, mask = self._crop(marks), None if marks.mask is None else self._full_mask(marks.mask)
        if crop is not None:
            crop.inside(mask)
            content[CROP] = f"{crop.x},{crop.y},{crop.width},{crop.height}\n".encode()
        if mask is not None:
            content["mask.png"] = encode_mask(mask)
        names, lights = [self.names[j] for j in kept], self.lights
        if marks.sphere is not None:
            circle = Circle(marks.sphere.x, marks.sphere.y, marks.sphere.r)
            found = self._look([circle], lambda j: self.images[j] / self.white, self.images.shape[1:3]).L
            lights = {name: l for name, l in zip(self.names, found, strict=True) if np.isfinite(l).all()}
        if marks.sphere is not None or (names != list(lights) and (lights or marks.left_out)):
            dark = next((name for name in names if name not in lights), None)
            if dark is not None:
                raise InputError(f"the light of {dark} is not known; mark a sphere, or leave that picture out.")
            content[self._lp()] = text.lp(names, np.stack([lights[name] for name in names]))
        gone = [CROP] if crop is None and (self.folder / CROP).is_file() else []
        if not content and not gone:
            raise InputError("nothing was marked; paint a mask, set a sphere or a crop, or leave a picture out.")
        own = find_mask(self.folder)
        if "mask.png" in content and own is not None and own.name != "mask.png":
            raise InputError(f"{own.name} is the folder's mask already; rename it, since only one can be read.")
        taken = [*gone, *(name for name in content if (self.folder / name).exists())]
        if taken and not marks.overwrite:
            return {"exist": taken}
        with at_once(self.folder) as batch:
            for name, data in content.items():
                batch.write(name, data)
            batch.remove += gone
        return {"saved": list(content), "next": self._next(content)}

    def _next(self, content: dict[str, bytes]) -> str:
        if not self.lights and not any(name.lower().endswith(".lp") for name in content):
            return "The folder has no lights yet: mark a sphere, or add light_directions.txt."
        return f"photonormal measure {shlex.quote(str(self.folder))} --out result"

    def _lp(self) -> str:
        """The name of the folder's own .lp file, since only one can be read."""
        found = sorted(p.name for p in self.folder.iterdir() if p.suffix.lower() == ".lp" and p.is_file())
        if (self.folder / "Normal_gt.mat").is_file() or (self.folder / "filenames.txt").is_file():
            raise InputError(
                "this folder's layout has lights of its own, which lights.lp would not replace; name the pictures "
                "with --images instead."
            )
        return found[0] if len(found) == 1 else "lights.lp"

    def _look(self, circles: list[Circle], read: Photograph, shape: tuple[int, ...]) -> Sphere:
        where = self.folder.resolve().name
        if shape[:2] != self.images.shape[1:3]:
            where += f" at 1/{self.step} of its size"  # in whose pixels it is said what is wrong
        return look_at_spheres(read, shape[:2], self.names, where, circles=circles)[0]

    def _suggested(self) -> tuple[np.ndarray, str]:
        """The folder's mask, one from the shading, or the whole frame; and which of them it is."""
        path = find_mask(self.folder)
        if path is not None:
            try:
                mask = read_drawn(path, self.paths)[0]
            except InputError:  # it fits as it is and turned: it is painted anew here, if need be
                mask = read_mask(path, self.images.shape[1:3])
            return means(mask.astype(np.float32), self.step) > 0.5, path.name
        try:
            return mask_from_shading(np.stack(evenly(self.grey, MASK_PICTURES)).astype(np.float32)), "found"
        except InputError:
            return np.ones(self.shown, bool), "whole"

    def _given_lights(self) -> dict[str, np.ndarray]:
        """The lights (3,) that the folder has for these pictures, by name."""
        try:
            capture = load(self.folder)
        except InputError:
            return {}
        if capture.lights is None or capture.lamps is not None:
            return {}
        found = dict(zip(capture.image_names, capture.lights, strict=True))
        return {name: found[name] for name in self.names if name in found}

    def _full_mask(self, painted: str) -> np.ndarray:
        mask = _enlarged(_inflated(painted, self.shown), self.step, self.images.shape[1:3])
        if not mask.any():
            raise InputError("the mask is empty; paint the object.")
        return mask

    def _crop(self, marks: Marks) -> Crop | None:
        if marks.crop is None:
            return None
        x0, y0, x1, y1 = marks.crop
        return Crop.chosen((x0, y0, x1 - x0, y1 - y0), 1, self.images.shape[1:3], "the crop")

    def _saved_crop(self) -> list[int] | None:
        """x0, y0, x1, y1 of the crop that was saved before; None where there is none, or it does not fit."""
        try:
            crop = Crop.chosen(own_crop(self.folder), 1, self.images.shape[1:3], CROP)
        except InputError:
            return None
        return None if crop is None else [crop.x, crop.y, crop.x + crop.width, crop.y + crop.height]


def _inflated(mask: str, shape: tuple[int, int]) -> np.ndarray:
    """The page's mask (rows, columns)."""
    try:
        data = zlib.decompressobj().decompress(base64.b64decode(mask, validate=True), shape[0] * shape[1])
    except (ValueError, zlib.error):
        data = b""
    if len(data) != shape[0] * shape[1]:
        raise InputError("the mask came in part only; save again.")
    return np.frombuffer(data, np.uint8).reshape(shape) > 0


def _enlarged(mask: np.ndarray, step: int, shape: tuple[int, int]) -> np.ndarray:
    """A mask of every `step`-th pixel at the photographs' size (rows, columns), its edge between pixels."""
    import cv2

    if step == 1:
        return mask
    h, w = mask.shape
    whole = cv2.resize(mask.astype(np.float32), (w * step, h * step), interpolation=cv2.INTER_LINEAR)
    return whole[: shape[0], : shape[1]] > 0.5


def _moved(circle: Circle, scale: float) -> Circle:
    """The circle in a picture `scale` times as large; pixel centres are whole numbers in both."""
    x, y = (scale * (v + 0.5) - 0.5 for v in (circle.x, circle.y))
    return Circle(x, y, scale * circle.r, circle.confidence, scale * circle.residual_px)
