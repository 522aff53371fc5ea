"""What a rendered set looks like: every choice is a field of a frozen dataclass, every named set is in RECIPES."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from photonormal.types import InputError, by_name


@dataclass(frozen=True)
class Rendering:
    """One rendered set.

    Scenes of `size` x `size` pixels are rendered, `scenes` of them at a time, and `crops` windows are cut from each:
    what casts shadows and reflects light into a window may lie outside it.
    """

    # frame
    size: int = 128
    crop: int = 32
    crops: int = 8
    scenes: int = 32
    coverage: float = 0.5  # least share of a window that is on the object
    hollows: float = 2.0  # how strongly half of the windows prefer parts below their surroundings
    zoom: float = 0.45  # share of scenes that show a part of the object only
    # shapes: shares of plain convex, blobs, figures, reliefs, machined, turned, piles, pleated
    shapes: tuple[float, ...] = (0.22, 0.13, 0.17, 0.15, 0.06, 0.14, 0.13, 0.0)
    detail: float = 1.0  # 0: smooth
    solid: str = "drawn"  # "bust": one fixed sculpture instead of drawn shapes
    meshes: str | None = (
        None  # folder of OBJ files, seen instead of drawn shapes; "data": PHOTONORMAL_DATA/meshes or none
    )
    mesh_share: float = 1.0  # share of the groups of scenes that see meshes, where there are any
    # materials: shares of principled, sgd, abc, neural, raw MERL files, Lambertian
    materials: tuple[float, ...] = (0.4, 0.25, 0.18, 0.15, 0.1, 0.02)
    metal: bool = False  # the principled materials are all metals
    varying: float = 0.5  # share whose material changes over the surface
    split: str = "train"  # of the measured materials' names: train, validation, all
    data: str | None = None  # folder of the measured materials; None: PHOTONORMAL_DATA/brdf, or principled only
    # light
    lights: tuple[int, int] = (32, 32)  # fewest and most of a batch, log-uniform
    narrow: float = 0.6  # share of light sets like DiLiGenT's; the rest span the hemisphere
    rig: str = "mixed"  # one kind of light set, from lights.KINDS, instead
    directions: tuple[tuple[float, float, float], ...] = ()  # of all scenes' lights as measured; true ones differ
    distance: float | None = None  # of the lamps, in half widths of the scene; None: infinitely far
    ambient: float = 0.01  # most light from everywhere, of a white surface's brightest
    # transport
    shadows: bool = True
    bounce: float = 0.65  # share of scenes with light between parts of the surface
    bounces: int = 1  # how often it passes there; beyond once it costs rays from all pixels of a scene
    # sensor
    smooth_edges: bool = True  # pixels on occluding edges mix both sides
    blurred: float = 0.3  # share of scenes that are not quite sharp
    saturated: float = 0.03  # most of the samples that exceed the sensor's range; none in 3 of 10 scenes
    noise: float = 0.015  # most, over a bright sample of the scene; a third of it in the dark
    low_bits: float = 0.2  # share of scenes in 8 bits; the others have 16
    # modest cameras and files (synth/coarse.py)
    dark: float = 0.0  # share of scenes whose brightest sample has but 20 to 255 grey levels, under uneven lights
    jpeg: float = 0.0  # share of scenes that went through JPEG, of qualities 60 to 95
    gamma: float = 0.0  # share of scenes whose linear values are off by a power of 0.9 to 1.1
    clipped: float = 0.0  # share of scenes with 3 to 15 % of the lit samples beyond the sensor's range
    # errors of the set-up
    intensity_error: float = 0.03  # most standard deviation of a light's measured intensity
    light_error_deg: float = 1.0  # most standard deviation of a light's measured direction
    corrupted: float = 0.5  # share of scenes in which some images are partly dimmed, brightened or shifted
    # file
    layout: str = "shards"  # diligent, blobby, shards


_PERFECT: dict[str, Any] = dict(
    intensity_error=0.0, light_error_deg=0.0, corrupted=0.0
)  # lights known exactly, nothing damaged
_NOISELESS: dict[str, Any] = dict(saturated=0.0, noise=0.0, blurred=0.0, low_bits=0.0, ambient=0.0, smooth_edges=False)
_STAND_IN: dict[str, Any] = dict(narrow=0.0, varying=0.0, zoom=0.0, **_PERFECT)
_WHOLE: dict[str, Any] = dict(crop=128, crops=1, zoom=0.0, layout="diligent")  # a window is a whole object

RECIPES: dict[str, Rendering] = {
    "train": Rendering(),
    "validation": Rendering(split="validation", zoom=0.3, **_PERFECT),
    "objects": Rendering(lights=(96, 96), narrow=1.0, split="validation", **_WHOLE, **_PERFECT),
    "preview": Rendering(lights=(4, 4), **{**_WHOLE, "zoom": 0.25}, **_PERFECT),
    "blobby": Rendering(lights=(64, 64), narrow=0.0, **{**_WHOLE, "layout": "blobby"}, **_PERFECT),
    # stand-ins for the sets that the paper learns from: lights from everywhere, exact; one material a sample
    "blobs": Rendering(shapes=(0.3, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), detail=0.25, **_STAND_IN),
    "sculptures": Rendering(
        shapes=(0.0, 0.0, 0.4, 0.25, 0.05, 0.15, 0.15, 0.0), detail=1.3, meshes="data", mesh_share=0.4, **_STAND_IN
    ),
    # pleats, folds and bowls of metal, whose walls mirror each other
    "hollow-metal": Rendering(
        shapes=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        materials=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        metal=True,
        varying=0.25,
        bounce=1.0,
        bounces=3,
    ),
    "demo": Rendering(
        size=160,
        scenes=1,
        solid="bust",
        lights=(24, 24),
        rig="stage",
        bounce=1.0,
        **{**_WHOLE, "crop": 160},
        **_PERFECT,
        **{**_NOISELESS, "saturated": 0.008, "noise": 0.002, "smooth_edges": True},
    ),
    "lambert": Rendering(
        lights=(32, 32),
        shapes=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        detail=0.0,
        materials=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        varying=0.0,
        shadows=False,
        bounce=0.0,
        **_WHOLE,
        **_PERFECT,
        **_NOISELESS,
    ),
}


MIXTURES = {  # name -> recipes and their shares of the blocks of a stream
    "blobs-and-sculptures": (
        ("blobs", 25_660),
        ("sculptures", 58_700),
    ),  # as many as the samples of Blobby and Sculpture
    "train-and-hollow-metal": (("train", 9), ("hollow-metal", 1)),
}


SHARES = (
    "coverage", "zoom", "mesh_share", "varying", "narrow", "ambient", "bounce", "blurred", "saturated", "low_bits",
    "dark", "jpeg", "gamma", "clipped", "corrupted",
)  # fmt: skip


def parts(name: str | Rendering, **changes: Any) -> list[tuple[Rendering, float]]:
    """The recipes of a mixture and their shares, which sum up to 1; or the one recipe of that name."""
    mixed = MIXTURES.get(name, ((name, 1),)) if isinstance(name, str) else ((name, 1),)
    return [(recipe(part, **changes), share / sum(s for _, s in mixed)) for part, share in mixed]


def recipe(name: str | Rendering, **changes: Any) -> Rendering:
    """A named recipe, or one that is given, with some fields changed.

    Raises
    ------
    InputError
        If there is no such recipe or field, or a value makes no sense.
    """
    given = by_name("recipe", name, RECIPES) if isinstance(name, str) else name
    known = [f.name for f in dataclasses.fields(Rendering)]
    for key in changes:
        if key not in known:
            raise InputError(f"a recipe has no {key!r}; it has {', '.join(known)}.")
    made = dataclasses.replace(given, **changes)
    check(made)
    return made


def check(made: Rendering) -> None:
    """Raise InputError where values make no sense."""
    low, high = made.lights
    if not 1 <= low <= high <= 300:
        raise InputError(f"lights are {made.lights} but 1 <= fewest <= most <= 300 is needed; change lights.")
    if made.size % 8 or not 8 <= made.crop <= made.size:
        raise InputError(
            f"size is {made.size} and crop {made.crop} but a size divisible by 8 and 8 <= crop <= size are needed."
        )
    if min(made.crops, made.scenes, made.bounces) < 1:
        raise InputError(
            f"crops is {made.crops}, scenes {made.scenes} and bounces {made.bounces} but at least 1 each is needed."
        )
    for key in ("shapes", "materials"):
        shares = getattr(made, key)
        if min(shares) < 0:
            raise InputError(f"{key} are {shares} but shares can't be negative; change them.")
    for key in SHARES:
        if not 0 <= getattr(made, key) <= 1:
            raise InputError(f"{key} is {getattr(made, key)} but a share from 0 to 1 is needed; change it.")
    for key in ("hollows", "detail", "noise", "intensity_error", "light_error_deg"):
        if not getattr(made, key) >= 0:
            raise InputError(f"{key} is {getattr(made, key)} but 0 or more is needed; change it.")
    if made.distance is not None and not made.distance > 0:
        raise InputError(f"distance is {made.distance} but half widths above 0 are needed; change it.")
    if made.solid not in ("drawn", "bust"):
        raise InputError(f"solid is {made.solid!r} but drawn or bust is needed; change it.")
    if len(made.shapes) != 8 or len(made.materials) != 6 or not sum(made.shapes) * sum(made.materials):
        raise InputError(
            f"shapes has {len(made.shapes)} shares and materials {len(made.materials)} but 8 and 6, not all zero, "
            "are needed."
        )
