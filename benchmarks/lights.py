"""Lights found from photographs: how wrong they are, and what they cost in normals.

    python benchmarks/lights.py ROOT                     # lights unknown; ROOT holds <object>PNG folders of DiLiGenT
    python benchmarks/lights.py ROOT --images 10         # of ten of the photographs, three draws
    python benchmarks/lights.py ROOT --method sdps       # SDPS-Net, which finds the lights itself
    python benchmarks/lights.py ROOT --wrong 5           # --refine-lights, from given ones that are 5 degrees off
    python benchmarks/lights.py ROOT --wrong 5 --turned 10   # the same, all lights turned about the view axis besides
    python benchmarks/lights.py ROOT --wrong 2 --halfway     # the same from halfway vectors that are off besides
    python benchmarks/lights.py --rendered 32 --seed 7   # lights unknown, on rendered objects of held-out materials

Angles are means in degrees; intensities' errors are scale-invariant, in per cent (`photonormal.scoring.lights`).
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import photonormal as pn
from photonormal.capture.texts import read_table
from photonormal.geometry import normalised, rotation_about_view
from photonormal.methods import configure
from photonormal.methods.inputs.grey import grey_samples
from photonormal.methods.uncalibrated import found_lights
from photonormal.scoring.lights import intensity_error, score_lights
from photonormal.types import Capture, InputError


def shaken(lights: np.ndarray, deg: float, g: np.random.Generator) -> np.ndarray:
    """Each light turned by its own error, `deg` in the mean (Rayleigh)."""
    tilt = g.normal(size=lights.shape)
    tilt -= (tilt * lights).sum(1, keepdims=True) * lights
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)
    angle = np.radians(deg) * g.rayleigh(1 / np.sqrt(np.pi / 2), (len(lights), 1))
    return lights * np.cos(angle) + tilt * np.sin(angle)


def misgiven(lights: np.ndarray, given: argparse.Namespace, g: np.random.Generator) -> np.ndarray:
    """Lights that are wrong as it is asked: halfway vectors in their place, turned together, each off by itself."""
    L = normalised(lights + np.array([0, 0, 1])) if given.halfway else lights
    return shaken(L @ rotation_about_view(given.turned).T, given.wrong, g)


def normals_deg(capture: Capture, method: str) -> float:
    """Mean error of the normals of a capture under its lights."""
    return pn.score(pn.solve(capture, method), capture.truth).mean_deg


def unknown(raw: Capture, known: Capture, e: np.ndarray, method: str) -> str:
    """A row of the table of lights that are unknown; `raw` is without lights, `known` with the true ones."""
    bare: Any = {"integration": None, "albedo": False, "expected_error": False, "examine": False}
    found = pn.measure(raw, method, lights="unknown", **bare)
    assert found.lights is not None
    off = score_lights(found.lights, known.known_lights(), found.intensities, e)
    under = pn.score(found.normals, known.truth).mean_deg
    best = "" if configure(method).needs.finds_lights else f" | {normals_deg(known, method):.2f}"
    return f"{off.mean_deg:.2f} | {off.intensity_percent:.1f} | {under:.2f}{best}"


def some(capture: Capture, chosen: np.ndarray, lights: bool) -> Capture:
    """Some images of a capture, in memory."""
    images = np.stack([capture.images[int(j)] for j in chosen])
    L = capture.known_lights()[chosen] if lights else None
    return Capture(images, capture.mask, L, truth=capture.truth, name=capture.name)


def real(given: argparse.Namespace) -> None:
    """Tables of DiLiGenT's objects."""
    images, method = given.images, given.method
    wrong = bool(given.wrong or given.halfway or given.turned)
    title = "before | after | normals, given | normals, mended" if wrong else "lights | intensities % | normals"
    title += "" if configure(method).needs.finds_lights else " | normals, true lights"
    print(f"| object | {title} |\n|{'---|' * (2 + title.count('|'))}")
    for name in given.objects.split(","):
        path = given.root / f"{name}PNG"
        raw, known = pn.load(path, lights="unknown"), pn.load(path)
        e = grey_samples(read_table(path / "light_intensities.txt").astype(np.float32))
        n = known.images.shape[0]
        for draw in range(3 if images or wrong else 1):
            g = np.random.default_rng(draw)
            if wrong:
                bad = replace(known, lights=misgiven(known.known_lights(), given, g))
                found = found_lights(bad, "refined")
                off = [score_lights(L, known.known_lights()).mean_deg for L in (bad.known_lights(), found.lights)]
                row = " | ".join(f"{v:.2f}" for v in off)
                under = (bad, found.shown_by(bad), known) if draw == 0 else ()
                row += "".join(f" | {normals_deg(c, method):.2f}" for c in under)
            else:
                chosen = np.sort(g.permutation(n)[: images or n])
                row = unknown(some(raw, chosen, False), some(known, chosen, True), e[chosen], method)
            print(f"| {name} | {row} |", flush=True)


def rendered(count: int, wide: bool, seed: int) -> None:
    """Errors on rendered objects of held-out materials, with lights' intensities between a half and twice."""
    from photonormal.synth import Stream

    whole = {"size": 128, "crop": 128, "crops": 1, "scenes": 4, "zoom": 0.0, "lights": (32, 32)}
    stream = iter(Stream("validation", 4, seed=2**30 + seed, **whole, narrow=0.0 if wide else 1.0))
    angles, wrong, refused = [], [], 0
    g = np.random.default_rng(seed)
    while len(angles) + refused < count:
        batch = next(stream)
        for images, L, mask in zip(batch.images, batch.lights, batch.mask, strict=True):
            e = np.exp(g.uniform(-np.log(2), np.log(2), len(L)))
            pictures = images.permute(0, 2, 3, 1).numpy() * e[:, None, None, None].astype(np.float32)
            try:
                found = found_lights(Capture(pictures, mask[0].numpy()), "unknown")
            except InputError as error:
                print(error)
                refused += 1
                continue
            assert found.intensities is not None
            angles.append(score_lights(found.lights, L.numpy().astype(float)).mean_deg)
            wrong.append(100 * intensity_error(found.intensities, e))
            print(f"{angles[-1]:.2f} {wrong[-1]:.1f} {' '.join(found.notes)}", flush=True)
    kind = "hemisphere" if wide else "narrow"
    print(
        f"{kind}, {count} objects: lights mean {np.mean(angles):.2f}, median {np.median(angles):.2f} degrees; "
        f"intensities mean {np.mean(wrong):.1f}, median {np.median(wrong):.1f} %; {refused} refused"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("root", nargs="?", type=Path)
    parser.add_argument("--objects", default="ball,bear,cat,reading")
    parser.add_argument("--images", type=int, default=0)
    parser.add_argument("--wrong", type=float, default=0.0)
    parser.add_argument("--turned", type=float, default=0.0)
    parser.add_argument("--halfway", action="store_true")
    parser.add_argument("--method", default="normalnet")
    parser.add_argument("--rendered", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if given.rendered:
        for wide in (False, True):
            rendered(given.rendered, wide, given.seed)
    elif given.root is None:
        parser.error("ROOT is needed, a folder that holds <object>PNG folders, or --rendered")
    else:
        real(given)


if __name__ == "__main__":
    main()
