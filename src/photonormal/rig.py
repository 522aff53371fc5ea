"""From the photographs of a rig to calibrated lights on disk: read -> calibrate -> write."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import photonormal
from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.mirror import mean_directions, nearest_point
from photonormal.calibration.sphere import Projection, Sphere, look_at_spheres
from photonormal.capture import files_read, load
from photonormal.capture.encoding import encodings
from photonormal.capture.images import ImageFiles, parts, read_mask
from photonormal.capture.pictures import find_mask, find_pictures, no_pictures, parse_images
from photonormal.capture.texts import read_lines
from photonormal.disk import at_once, refuse_taken
from photonormal.geometry import angle_deg, in_frame, normalised
from photonormal.options import Coordinate, LightsFrom, Positive, check_value
from photonormal.progress import progress
from photonormal.resources import cores, in_threads
from photonormal.types import InputError

if TYPE_CHECKING:
    from photonormal.doctor.finding import Finding
    from photonormal.doctor.given import Near

REFERENCE_PIXELS = 3000  # of the object that intensities are found from
MASK_PICTURES = 16  # that a mask is found from
AUTO = "AUTO"  # the spheres are in the object's own photographs


def calibrate(
    folder: str | Path,
    spheres: Sequence[str | Path] = (AUTO,),
    out: str | Path = "lights.lp",
    circles: Sequence[str] = (),
    count: int = 1,
    focal_px: float | None = None,
    radius_mm: float | None = None,
    frame: str = "opengl",
    skip: str = "",
    overwrite: bool = False,
) -> dict[str, Any]:
    """Light directions from photographs of one or several mirror spheres.

    Parameters
    ----------
    folder : the object's photographs, which the lights are for
    spheres : folders with photographs of a sphere under the same lights in the same order; "AUTO": `folder` itself
    out : `.lp` file; `light_directions.txt`, a JSON report and a picture of what was found are written beside it
    circles : outlines "x,y,r", in pixels from the upper left, in the order of the spheres; found where there are none
    count : spheres in each folder of photographs
    focal_px : focal length in pixels, for spheres near the camera; None: orthographic
    frame : of what is written, a key of photonormal.geometry.FRAMES
    radius_mm : the spheres' radius; with two or more in one frame the lights' positions are found and written too
    skip : photographs left out, numbers and ranges from 1: "3,7-9"

    Returns
    -------
    The report, as written: of the lights whose highlights every sphere shows.

    Raises
    ------
    InputError
        If a sphere, several highlights or a picture are missing; of what was looked at `<out>_refused.png` is written.
    """
    out = Path(out)
    if out.suffix.lower() != ".lp":
        raise InputError(f"--out {out} ends in {out.suffix!r} but an .lp file is written; choose a name that ends so.")
    files = {
        "lp": out,
        "table": out.with_name("light_directions.txt"),
        "report": out.with_suffix(".json"),
        "picture": out.with_name(f"{out.stem}_spheres.png"),
    }
    refused = out.with_name(f"{out.stem}_refused.png")
    given = [_circle(c) for c in circles]
    if radius_mm is not None and len(spheres) * count > 1:
        files["positions"] = out.with_name("light_positions.txt")
    refuse_taken(files.values(), overwrite)
    from photonormal.calibration.picture import beside, drawn
    from photonormal.export import lights as text
    from photonormal.export.folder import as_json
    from photonormal.png import encode_png

    photographs = numbered_pictures(Path(folder))
    places = [Path(folder), *(Path(p) for p in spheres if str(p) != AUTO)]
    refuse_taken(files.values(), overwrite, reads=[*photographs, *(p for place in places for p in pictures_of(place))])
    names = [p.name for p in photographs]
    dropped = set(parse_images(skip, len(names), "--skip")) if skip.strip() else set()
    kept = [j for j in range(len(names)) if j not in dropped]
    if not kept:
        raise InputError(f"--skip {skip} leaves out all {len(names)} photographs; leave out fewer.")
    camera, found, pictures = Projection(focal_px), [], []
    for k, place in enumerate(spheres):
        path = Path(folder) if str(place) == AUTO else Path(place)
        share = given[k * count : (k + 1) * count]
        if share and len(share) < count:
            raise InputError(
                f"{len(given)} circles came for {len(spheres) * count} spheres; give one for each, or none."
            )
        with progress(f"spheres in {path.name}"):
            images = _images(path, names, kept)
            try:
                here = _spheres(path, images, share, count, camera, own=str(place) == AUTO)
            except SphereError as refusal:
                with at_once(out.parent) as batch:
                    batch.write(refused.name, encode_png(drawn(_brightest(images), [], refusal.circles)))
                raise InputError(f"{refusal} {refused} shows it.") from None
        found += here
        pictures.append(drawn(_brightest(images), here))
    names = [names[j] for j in kept]
    warnings = [line for s in found for line in s.doubts(names)]
    shown = np.all([np.isfinite(s.L).all(1) for s in found], axis=0)
    names = [name for name, there in zip(names, shown, strict=True) if there]
    found = [s.of(shown) for s in found]
    L = mean_directions([s.L for s in found])  # (n, 3)
    written = in_frame(L, frame)
    content: dict[str, Any] = {
        "photonormal": photonormal.__version__,
        "folder": Path(folder).resolve().name,
        "frame": frame,
        "axes": "from the object to the light; opengl: x right, y up, z to the camera",
        "view": "orthographic" if focal_px is None else f"perspective, focal length {focal_px:g} px",
        "spheres": [
            {
                "folder": s.where,
                "circle": asdict(s.circle),
                "confidence": s.confidence,
                "confidence_elsewhere": s.rival,
            }
            for s in found
        ],
        "lights": [
            {
                "picture": name,
                "direction": written[j],
                "off_mean_deg": [round(float(angle_deg(s.L[j], L[j])), 4) for s in found],
                "highlights": [asdict(h) for s in found if (h := s.highlights[j])],
            }
            for j, name in enumerate(names)
        ],
        "warnings": warnings,
    }
    tables = {"table": written}
    if radius_mm is not None and len(found) > 1:
        if len(spheres) > 1:
            raise InputError(
                f"the spheres come from {len(spheres)} folders but their places in one frame are needed for the "
                "lights' positions; photograph them together and give --count, or leave --radius-mm out."
            )
        X, miss = _positions(found, radius_mm, focal_px)
        content["position_origin"] = (
            "the middle of the picture, at the spheres' depth" if focal_px is None else "camera"
        )
        for light, x, m in zip(content["lights"], X, miss, strict=True):
            light |= {"position_mm": in_frame(x, frame), "lines_miss_mm": round(m, 4)}
        tables["positions"] = in_frame(X, frame)
    with at_once(out.parent) as batch:
        for name, rows in tables.items():
            batch.write(files[name].name, text.table(rows))
        batch.write(files["report"].name, as_json(content))
        batch.write(files["picture"].name, encode_png(beside(pictures)))
        batch.write(out.name, text.lp(names, written))
        if refused.is_file():
            batch.remove.append(refused.name)
    return content | {"files": [str(p) for p in files.values()]}


def check(
    capture: str | Path,
    out: str | Path | None = None,
    overwrite: bool = False,
    lights_from: LightsFrom = "given",
    **how: Any,
) -> tuple[list[Finding], list[Path]]:
    """What is wrong with a capture, grave findings first, and the files written.

    Parameters
    ----------
    capture : folder or `.lp` file, as for `photonormal.load`, which `how` is passed on to
    out : folder for report.json, a polar plot of the lights, and corrected lights where other ones fit; None: no files
    lights_from : "given", or those that are checked are found from the photographs first, as `pn.measure` does it
    """
    from photonormal.doctor.coverage import polar_plot
    from photonormal.examination import check as findings_of
    from photonormal.export import lights as text
    from photonormal.export.folder import report, whole_folder
    from photonormal.png import encode_png

    photographs, told = load(capture, **how), None
    if lights_from != "given":
        from photonormal.methods.uncalibrated import found_lights

        told = found_lights(photographs, lights_from)
        photographs = told.shown_by(photographs)
    found = findings_of(photographs, told)
    if out is None:
        return found, []
    with whole_folder(Path(out), overwrite, files_read(capture, photographs, *how.values())) as folder:
        names, L = photographs.image_names, photographs.lights
        content = {
            "photonormal": photonormal.__version__,
            "capture": photographs.name,
            "images": list(names),
            "crop": None if photographs.crop is None else photographs.crop.as_dict(),
            "findings": [f.as_dict() for f in found],
        }
        if L is not None:
            folder.write("lights.png", encode_png(polar_plot(L)))
        fixed = next((f.lights for f in found if f.lights is not None), None)
        if fixed is not None:
            camera, crop = photographs.camera if photographs.lamps is not None else None, photographs.crop
            middle = 0 if camera is None else camera.flat_mm(photographs.mask).mean(0)  # lamps' are positions
            origin = 0 if camera is None or crop is None else crop.origin_mm(camera)
            folder.write("corrected.lp", text.lp(names, fixed + origin))  # of the whole photographs
            folder.write("corrected.png", encode_png(polar_plot(normalised(fixed - middle))))
        report(folder, content)
    return found, [Path(out) / name for name in sorted(folder.names)]


def intensities(
    capture: str | Path,
    out: str | Path = "light_intensities.txt",
    reference: str | Path | None = None,
    region: str = "",
    overwrite: bool = False,
    **how: Any,
) -> np.ndarray:
    """Intensities (n, c) of a capture's lights, their mean 1, written as a table.

    Parameters
    ----------
    capture : folder or `.lp` file, as for `photonormal.load`, which `how` is passed on to; of near lamps the object's
        own shading tells what they send out, the board what arrives at its distance
    out : `light_intensities.txt`, which is read where it lies beside the photographs
    reference : folder with photographs of a matt white or grey board that faces the camera, under the same lights in
        the same order; without it and `region`, intensities are found from the object's own shading
    region : "x0,y0,x1,y1" in pixels: where the board is, in the reference's photographs or in the object's; the whole
        frame of the reference without it
    """
    from photonormal.calibration.intensities import from_reference, self_calibrated
    from photonormal.doctor.given import Near
    from photonormal.export import lights as text

    out = Path(out)
    refuse_taken([out], overwrite)
    photographs = load(capture, **how)
    refuse_taken([out], overwrite, files_read(capture, photographs, *how.values()))
    n, c = photographs.images.shape[0], photographs.images.shape[3]
    L = photographs.known_lights()
    with progress("intensities"):
        if reference is not None or region:
            paths = numbered_pictures(Path(reference if reference is not None else capture))
            if len(paths) != n:
                raise InputError(
                    f"{reference or capture} holds {len(paths)} photographs of the board but {n} are needed."
                )
            images = ImageFiles(
                paths, None, np.ones((n, 1)), encodings(paths, bool(how.get("srgb")), bool(how.get("linear")))
            )
            box = _region(region, images.shape[1:3])
            levels = np.stack(images_of(images, lambda image: np.median(image[box], axis=(0, 1))))
            e = from_reference(levels, str(reference or capture), np.array([0.0, 0, 1]), L)
        else:
            inside = np.flatnonzero(photographs.mask)
            some = slice(None, None, max(1, inside.size // REFERENCE_PIXELS))
            I = np.stack(photographs.map_images(lambda _, image: image.reshape(-1, c)[inside[some]]), axis=1)
            lit = np.all((I > 0).any(1), axis=-1)
            I = I[lit].astype(np.float64)  # (p, n, c)
            if len(I) < 100:
                raise InputError(f"{photographs.name} shows too little light on the object to tell intensities from.")
            lamps, camera = photographs.lamps, photographs.camera
            if lamps is None or camera is None:
                e = np.stack([self_calibrated(I[..., k], L)[0] for k in range(c)], axis=-1)
            else:
                X = camera.flat_mm(photographs.mask)[some][lit]
                e = np.stack([_of_lamps(Near(I[..., k], X, lamps)) for k in range(c)], axis=-1)
    with at_once(out.parent) as batch:
        batch.write(out.name, text.table(e))
    return e


def _of_lamps(near: Near) -> np.ndarray:
    """Intensities (n,) of near lamps themselves, without their distance, for an object that is nearly flat."""
    from photonormal.calibration.intensities import self_calibrated

    e = np.ones(len(near.vectors))
    for _ in range(3):  # how light falls off over the object is told from pictures of equal lamps
        e = e * self_calibrated(near.showing(near.levels / e).seen(), near.directions())[0]
    return e


def draw_mask(folder: str | Path, out: str | Path = "mask.png", overwrite: bool = False) -> tuple[Path, Path]:
    """The object's mask from its shading, and a preview of it, as pictures; returns their paths."""
    from photonormal.calibration.mask import mask_from_shading
    from photonormal.png import encode_png

    out = Path(out)
    shown = out.with_name(f"{out.stem}_preview.png")
    refuse_taken([out, shown], overwrite)
    paths = numbered_pictures(Path(folder))
    refuse_taken([out, shown], overwrite, paths)
    images = ImageFiles(paths[:: max(1, len(paths) // MASK_PICTURES)], None, np.ones((len(paths), 1)))
    pictures = np.stack(images_of(images, lambda image: image.mean(-1)))
    mask = mask_from_shading(pictures)
    level = np.quantile(pictures, 0.9, axis=0)
    grey = np.rint(255 * (level / max(float(np.quantile(level, 0.99)), 1e-12)).clip(0, 1) ** (1 / 2.2))
    preview = np.repeat(grey[..., None], 3, axis=-1)
    preview[~mask] = preview[~mask] / 3 + np.array([0, 0, 90])
    with at_once(out.parent) as batch:
        batch.write(out.name, encode_png(mask.astype(np.uint8) * np.uint8(255)))
        batch.write(shown.name, encode_png(preview.astype(np.uint8)))
    return out, shown


def images_of(images: ImageFiles, f: Callable[[np.ndarray], np.ndarray]) -> list[np.ndarray]:
    """``f(image)`` of every picture, in order, in threads."""
    return in_threads(lambda j: f(images[j]), range(len(images)), cores())


def _region(text: str, shape: Sequence[int]) -> tuple[slice, slice]:
    if not text:
        return slice(0, shape[0]), slice(0, shape[1])
    try:
        x0, y0, x1, y1 = (int(v) for v in text.split(","))
    except ValueError:
        raise InputError(
            f"--region {text[:40]!r} came but x0,y0,x1,y1 in whole pixels is needed; correct it."
        ) from None
    if not (0 <= x0 < x1 <= shape[1] and 0 <= y0 < y1 <= shape[0]):
        raise InputError(f"--region {text} lies outside the photographs of {shape[1]} x {shape[0]} pixels; correct it.")
    return slice(y0, y1), slice(x0, x1)


def numbered_pictures(folder: Path) -> list[Path]:
    """The photographs of a folder, one for each light: those that `filenames.txt` lists, or those with a number.

    `ref.jpg` or `ambient.png` beside `001.png`, `002.png`, ... is no photograph under one light.
    """
    _check_folder(folder)
    if (folder / "filenames.txt").is_file():
        return [folder / name for name in read_lines(folder / "filenames.txt")]
    pictures = find_pictures(folder)
    numbered = [p for p in pictures if re.search(r"\d", p.stem)]
    if not pictures:
        raise no_pictures(folder)
    return numbered or pictures


def pictures_of(folder: Path) -> list[Path]:
    """Every picture of a folder that a calibration may read, its mask included."""
    _check_folder(folder)
    mask = find_mask(folder)
    return [*find_pictures(folder), *([mask] if mask else [])]


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder but one with photographs is needed; give that.")


def _images(folder: Path, names: Sequence[str], kept: Sequence[int]) -> ImageFiles:
    """The sphere's pictures of a folder that belong to those `kept` of the object's pictures `names`."""
    paths = _in_order_of(names, numbered_pictures(folder), folder)
    return ImageFiles([paths[j] for j in kept], None, np.ones((len(kept), 1)))


def _spheres(
    folder: Path, images: ImageFiles, circles: Sequence[Circle], count: int, camera: Projection, own: bool
) -> list[Sphere]:
    """The spheres that a folder's pictures show; a mask in the object's own folder is not the sphere's."""
    others = [p for p in find_pictures(folder) if not re.search(r"\d", p.stem) and p not in images.pictures]
    scale = 1 / float(images[0].max() or 1) if images.dtype.kind == "f" else 1.0  # floats have no full scale

    def other(path: Path) -> Any:
        picture = ImageFiles([path], None, np.ones((1, 1)))
        return (lambda _: picture[0]) if picture.shape[1:3] == images.shape[1:3] else None

    mask = None if circles or own else find_mask(folder)
    return look_at_spheres(
        lambda j: images[j] * scale,
        images.shape[1:3],
        [parts(p)[0].name for p in images.pictures],
        folder.resolve().name,
        circles=circles,
        mask=None if mask is None else read_mask(mask),
        extra=[] if circles or mask else [read for read in map(other, others) if read is not None],
        spheres=count,
        camera=camera,
    )


def _brightest(images: ImageFiles) -> np.ndarray:
    """The brightest grey level of every pixel, (h, w)."""
    brightest = np.zeros(images.shape[1:3], np.float32)
    for j in range(len(images)):
        np.maximum(brightest, images[j].mean(-1), out=brightest)
    return brightest / max(1.0, float(brightest.max()))


def _in_order_of(names: Sequence[str], pictures: Sequence[Path], folder: Path) -> list[Path]:
    """The sphere's pictures in the order of the object's: by name where names agree, else as they come."""
    by_name = {p.name: p for p in pictures}
    if all(name in by_name for name in names):
        return [by_name[name] for name in names]
    if len(pictures) != len(names):
        raise InputError(
            f"{folder} shows the sphere under {len(pictures)} lights but there are {len(names)} photographs of the "
            "object; one picture of each for every light is needed, in the same order."
        )
    return list(pictures)


def _circle(text: str) -> Circle:
    try:
        x, y, r = (float(v) for v in text.split(","))
    except ValueError:
        raise InputError(
            f"--circle {text[:40]!r} came but x,y,r is needed: centre from the upper left and radius, in pixels."
        ) from None
    for value, kind in ((x, Coordinate), (y, Coordinate), (r, Positive)):
        check_value(value, kind, f"--circle {text[:40]} with")
    return Circle(x, y, r)


def _positions(found: Sequence[Sphere], radius_mm: float, focal_px: float | None) -> tuple[np.ndarray, list[float]]:
    """Positions of the lights (n, 3) in mm and by how much the spheres' lines to each miss one another."""
    if focal_px is None:
        mm = radius_mm / np.mean([s.circle.r for s in found])  # a pixel
        x0, y0 = Projection().axis(found[0].shape)
        points = [np.array([s.circle.x - x0, y0 - s.circle.y, 0]) * mm + radius_mm * s.points for s in found]
    else:
        points = [radius_mm * s.points for s in found]
    solved = [
        nearest_point(np.stack([p[j] for p in points]), np.stack([s.L[j] for s in found]))
        for j in range(len(found[0].L))
    ]
    return np.stack([x for x, _ in solved]), [m for _, m in solved]
