"""From photographs of mirror spheres to lights on disk."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import photonormal
from photonormal.calibration.circle import Circle, SphereError
from photonormal.calibration.mirror import mean_directions, nearest_point
from photonormal.calibration.sphere import Projection, Sphere, look_at_spheres
from photonormal.capture.images import ImageFiles, files_of, read_mask
from photonormal.capture.pictures import find_mask, find_pictures, parse_images
from photonormal.disk import at_once, refuse_taken
from photonormal.doctor.finding import counted
from photonormal.geometry import angle_deg, in_frame
from photonormal.options import Coordinate, Positive, check_value
from photonormal.progress import progress
from photonormal.resources import by_one_thread
from photonormal.rig.pictures import brightest_of, numbered_pictures, pictures_for, pictures_of
from photonormal.types import InputError

AUTO = "AUTO"  # the spheres are in the object's own photographs
APART_DEG = 10.0  # of a sphere's light from the mean of all spheres': a lamp three widths away differs by as much


@by_one_thread()
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
    if radius_mm is not None and len(spheres) > 1:
        raise InputError(
            f"the spheres come from {len(spheres)} folders but their places in one frame are needed for the "
            "lights' positions; photograph them together and give --count, or leave --radius-mm out."
        )
    if radius_mm is not None and count < 2:
        raise InputError(
            f"--radius-mm {radius_mm:g} came for one sphere but the lights' positions need two or more in one frame: "
            "give --count, or leave --radius-mm out."
        )
    files = _files(out, positions=radius_mm is not None)
    refused = out.with_name(f"{out.stem}_refused.png")
    given = [_circle(c) for c in circles]
    every = len(spheres) * count
    if len(given) not in (0, every):
        raise InputError(
            f"{counted(len(given), 'circle', 'circles')} came for {counted(every, 'sphere', 'spheres')}; "
            "give one for each, and how many a photograph shows with --count, or no circle."
        )
    refuse_taken(files.values(), overwrite)
    from photonormal.calibration.picture import drawn, in_one_row
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
        with progress(f"spheres in {path.name}"):
            images = _images(path, names, kept)
            try:
                here = _spheres(path, images, share, count, camera, own=str(place) == AUTO)
            except SphereError as refusal:
                with at_once(out.parent) as batch:
                    batch.write(refused.name, encode_png(drawn(brightest_of(images), [], refusal.circles)))
                raise InputError(f"{refusal} {refused} shows it.") from None
        found += here
        pictures.append(drawn(brightest_of(images), here))
    names = [names[j] for j in kept]
    warnings = [line for s in found for line in s.doubts(names)]
    shown = np.all([np.isfinite(s.L).all(1) for s in found], axis=0)
    names = [name for name, there in zip(names, shown, strict=True) if there]
    found = [s.of(shown) for s in found]
    L = mean_directions([s.L for s in found])  # (n, 3)
    warnings += _disagreement(found, L, names)
    tables = {"table": in_frame(L, frame)}
    content: dict[str, Any] = {
        "photonormal": photonormal.__version__,
        "folder": Path(folder).resolve().name,
        "frame": frame,
        "axes": "from the object to the light; opengl: x right, y up, z to the camera",
        "view": "orthographic" if focal_px is None else f"perspective, focal length {focal_px:g} px",
        **_shown(found, L, tables["table"], names),
        "warnings": warnings,
    }
    if radius_mm is not None and "positions" in files:
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
        batch.write(files["picture"].name, encode_png(in_one_row(pictures)))
        batch.write(out.name, text.lp(names, tables["table"]))
        if refused.is_file():
            batch.remove.append(refused.name)
    return content | {"files": [str(p) for p in files.values()]}


def _disagreement(found: Sequence[Sphere], L: np.ndarray, names: Sequence[str]) -> list[str]:
    """What to say where spheres see a light in other directions than their mean L (n, 3)."""
    off = np.max([angle_deg(s.L, L) for s in found], axis=0)  # (n,)
    if not (off > APART_DEG).any():
        return []
    j, several = int(off.argmax()), int((off > APART_DEG).sum())
    return [
        f"the spheres disagree about {several} of {len(names)} lights: that of {names[j]} differs by {off[j]:.0f} "
        "degrees from the mean, which was used. A circle is off, a folder's pictures are in another order, or lamps "
        "are near. Positions of near lamps need two spheres in one frame and --radius-mm."
    ]


def _files(out: Path, positions: bool) -> dict[str, Path]:
    """What is written beside an .lp file."""
    if out.suffix.lower() != ".lp":
        raise InputError(f"--out {out} ends in {out.suffix!r} but an .lp file is written; choose a name that ends so.")
    files = {
        "lp": out,
        "table": out.with_name("light_directions.txt"),
        "report": out.with_suffix(".json"),
        "picture": out.with_name(f"{out.stem}_spheres.png"),
    }
    return files | ({"positions": out.with_name("light_positions.txt")} if positions else {})


def _shown(found: Sequence[Sphere], L: np.ndarray, written: np.ndarray, names: Sequence[str]) -> dict[str, Any]:
    """The spheres, and the lights L (n, 3) that they show together, which are `written` in another frame."""
    return {
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
    }


def _images(folder: Path, names: Sequence[str], kept: Sequence[int]) -> ImageFiles:
    """The sphere's pictures of a folder that belong to those `kept` of the object's pictures `names`."""
    paths = pictures_for(names, folder, "the sphere")
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
        [files_of(p)[0].name for p in images.pictures],
        folder.resolve().name,
        circles=circles,
        mask=None if mask is None else read_mask(mask),
        extra=[] if circles or mask else [read for read in map(other, others) if read is not None],
        spheres=count,
        camera=camera,
    )


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
