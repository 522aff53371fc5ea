"""Test scenes of fixed seeds, traced with several bounces and written once in the layouts of published benchmarks.

spheres100, statue100   <out>/<material>/               DiLiGenT: an object in 100 measured materials, 100 random lights
cycles17                <out>/L17/<object>.obj/         CyclesPS: three objects, three kinds of material, 17 lights
                        <out>/L305/<object>.obj/        and 305
clean                   <out>/<object>/                 DiLiGenT: matt objects, 48 lights
hollows                 <out>/<object>/                 DiLiGenT: pleats of gold, copper and aluminium, 48 lights
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from photonormal.disk import at_once
from photonormal.geometry import fibonacci_cap
from photonormal.synth.layout import RenderedObject
from photonormal.synth.library import data_folder
from photonormal.synth.pathtraced import tracer
from photonormal.synth.pathtraced.cycles import KINDS, cells, kind_of_material
from photonormal.synth.pathtraced.meshes import Triangles
from photonormal.synth.pathtraced.objects import OBJECTS
from photonormal.synth.pathtraced.reflectance import bsdf, diffuse, fitted_parameters
from photonormal.synth.pathtraced.tracer import OrthographicCamera
from photonormal.synth.pathtraced.write import write_cyclesps, write_object
from photonormal.types import InputError, by_name

BRIGHTEST = 200.0  # bound of pi f in the measured materials
INDIRECT = 5.0  # most that one path's bounced light counts, in times a white surface
SATURATED = 0.001  # share of an object's samples that are


@dataclass(frozen=True)
class SceneSet:
    """One set of test scenes."""

    shapes: tuple[str, ...]  # of OBJECTS
    lights: tuple[int, ...]  # counts; several are several copies of the set
    surface: str  # "measured", "cycles", "matt" or "metal"
    bounces: int  # how often light passes between surfaces; a convex object needs none
    samples: int  # paths a pixel
    random: bool = False  # light directions: drawn over the hemisphere instead of spread evenly
    seed: int = 100


SCENE_SETS = {
    "spheres100": SceneSet(("sphere",), (100,), "measured", 0, 8, random=True),
    "statue100": SceneSet(("statue",), (100,), "measured", 4, 16, random=True),
    "cycles17": SceneSet(("sphere", "turtle", "bowl"), (17, 305), "cycles", 4, 24),
    "clean": SceneSet(("sphere", "turtle", "bowl", "statue"), (48,), "matt", 4, 32),
    "hollows": SceneSet(("bowl", "flutes", "crumple", "folds", "pouch"), (48,), "metal", 4, 64),
}
METALS = {  # Mitsuba's own conductors: its name of the metal, and the width of its GGX highlights
    "bowl": ("Au", 0.2),
    "flutes": ("Cu", 0.3),
    "crumple": ("Au", 0.3),
    "folds": ("Al", 0.25),
    "pouch": ("Au", 0.15),
}


def render_scene_set(
    name: str,
    out: Path | str | None = None,
    objects: int | Sequence[str] | None = None,
    lights: int | Sequence[int] | None = None,
    resolution: int = 128,
    data: Path | str | None = None,
    family: str = "abc",
    samples: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Render a set, or what is missing of it, and return its folder.

    A set that is there already is returned as it is; one that was interrupted is completed.

    Parameters
    ----------
    name : a key of SCENE_SETS
    out : folder; None: `photonormal/<name>` in the user's cache folder
    objects : names (materials of a set of measured materials, else shapes), or how many, evenly picked; None: all
    lights : how many lights; None: as many as the set has
    resolution : pixels a side
    data : folder that holds `brdf` and `meshes`; None: PHOTONORMAL_DATA
    family : "abc" or "sgd", the fits of the measured materials; the latter gives some highlights coloured rims
    samples : paths a pixel; None: as many as the set has
    progress : called with the objects done and their number

    Raises
    ------
    InputError
        If the set, an object or a file is unknown, or the folder holds a set that was made with other arguments.
    """
    made = by_name("scene set", name, SCENE_SETS)
    counts = made.lights if lights is None else (lights,) if isinstance(lights, int) else tuple(lights)
    if min(counts, default=0) < 3 or resolution < 8:
        raise InputError(f"{counts} lights at {resolution} pixels came but at least 3 and 8 are needed; ask for more.")
    folder = _data(data)
    fits = fitted_parameters(folder / "brdf", family) if made.surface == "measured" else {}
    chosen = _chosen(name, list(fits) or list(made.shapes), objects)
    out = cache_folder(name) if out is None else Path(out)
    settings = {
        "set": name, "lights": list(counts), "resolution": resolution, "samples": samples or made.samples,
        "bounces": made.bounces, "seed": made.seed, "family": family if fits else None,
    }  # fmt: skip
    seconds = _open(out, settings)
    L = [directions(made, n) for n in counts]
    shapes = {shape: OBJECTS[shape](folder / "meshes") for shape in (made.shapes if fits else chosen)}
    for k, item in enumerate(chosen):
        if item not in seconds:
            started = time.perf_counter()
            mesh = shapes[made.shapes[0] if fits else item]
            surfaces = {"": bsdf(family, fits[item], BRIGHTEST)} if fits else {}
            _render(out, item, made, mesh, surfaces, L, resolution, settings["samples"])
            seconds[item] = round(time.perf_counter() - started, 2)
            _save(out, settings, seconds)
        if progress is not None:
            progress(k + 1, len(chosen))
    return out


def cache_folder(name: str) -> Path:
    """Where a set is kept when no folder is given."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "photonormal" / name


def directions(made: SceneSet, n: int) -> Float[np.ndarray, "n 3"]:
    """`n` unit light directions of a set: random ones 5 degrees above the horizon or more, even ones 20."""
    if not made.random:
        return fibonacci_cap(n, 20)
    g = np.random.default_rng(made.seed)
    z, phi = g.uniform(np.sin(np.radians(5)), 1, n), g.uniform(0, 2 * np.pi, n)
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)


def _render(
    out: Path,
    item: str,
    made: SceneSet,
    mesh: Triangles,
    surfaces: dict[str, Any],
    L: list[np.ndarray],
    size: int,
    samples: int,
) -> None:
    """All images of one object, in all its materials, written whole or not at all."""
    camera = OrthographicCamera(half=1.05, size=size)
    if made.surface == "matt":
        surfaces = {"": diffuse((0.6, 0.55, 0.5))}
    elif made.surface == "metal":
        metal, alpha = METALS[item]
        surfaces = {"": {"type": "roughconductor", "material": metal, "distribution": "ggx", "alpha": alpha}}
    elif made.surface == "cycles":
        surfaces = {kind: kind_of_material(kind) for kind in KINDS}
    images = {}
    for k, (kind, surface) in enumerate(surfaces.items()):
        painted = cells(mesh, kind, made.seed + k) if made.surface == "cycles" else mesh
        scene = tracer.build([painted.shape(surface)], camera)
        I = tracer.trace(scene, camera, np.concatenate(L), samples, made.bounces, made.seed, bound=INDIRECT)
        images[kind] = np.split(_exposed(I), np.cumsum([len(l) for l in L])[:-1])
    scene = tracer.build([mesh.shape({"type": "diffuse"})], camera)
    seen, whole = tracer.look(scene, camera), tracer.covered(scene, camera)
    mask = seen.mask & whole
    normals = np.where(mask[..., None], seen.normals, 0)
    for i, l in enumerate(L):
        if made.surface == "cycles":
            folder = out / f"L{len(l)}" / f"{item}.obj"
            write_cyclesps(folder, {k: v[i] for k, v in images.items()}, l, normals, mask)
        else:
            folder = out / item if len(L) == 1 else out / f"L{len(l)}" / item
            write_object(folder, RenderedObject(images[""][i], l, normals, mask))


def _exposed(I: Float[np.ndarray, "n s s 3"]) -> Float[np.ndarray, "n s s 3"]:
    """Images of one exposure at which the share SATURATED of the samples that got light exceeds 1."""
    lit = I[I > 0]
    return I / np.quantile(lit[:: max(1, lit.size // 2**20)], 1 - SATURATED)


def _chosen(name: str, known: list[str], objects: int | Sequence[str] | None) -> list[str]:
    if objects is None:
        return known
    if isinstance(objects, int):
        if not 1 <= objects <= len(known):
            raise InputError(f"{objects} objects came but {name} has 1 to {len(known)}; choose from those.")
        return [known[i] for i in np.unique(np.linspace(0, len(known) - 1, objects).round().astype(int))]
    for item in objects:
        if item not in known:
            raise InputError(
                f"{name} has no object {item!r}; there are {', '.join(known[:6])}{', ...' * (len(known) > 6)}."
            )
    return list(objects)


def _data(data: Path | str | None) -> Path:
    """Folder with `brdf` and `meshes`; one that isn't there only matters to sets that need it."""
    if data is not None:
        return Path(data)
    found = data_folder()
    return found.parent if found else Path(os.environ.get("PHOTONORMAL_DATA", "PHOTONORMAL_DATA"))


def _open(out: Path, settings: dict[str, Any]) -> dict[str, float]:
    """Seconds of each object that is there already."""
    path = out / "set.json"
    if not path.exists():
        if out.is_dir() and any(out.iterdir()):
            raise InputError(f"{out} holds other things than a set; give another folder.")
        _save(out, settings, {})
    try:
        kept = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror}); give another folder.") from None
    except ValueError:
        kept = None
    if not isinstance(kept, dict) or not isinstance(kept.get("seconds"), dict):
        raise InputError(f"{path} is damaged; remove {out} and render the set again.")
    if kept.get("settings") != settings:
        raise InputError(f"{out} holds a set made with other arguments; give another folder or remove that one.")
    return kept["seconds"]


def _save(out: Path, settings: dict[str, Any], seconds: dict[str, float]) -> None:
    text = json.dumps({"settings": settings, "seconds": seconds}, indent=1) + "\n"
    with at_once(out) as batch:
        batch.write("set.json", text.encode())
