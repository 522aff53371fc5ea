"""The doctor's rates: how often a right capture is blamed, and how often what was done to one is found.

    python benchmarks/doctor.py [--count 40] [--seed 1] [--kinds plate,coin,...] [--faults right,sRGB,...] [--size 112]

Renders captures of flat reliefs (plates, plaques, coins, tablets, weaves) and of objects, matt and glossy, plain and
textured, with noise, of 8 and 16 bits, with rectangular and round masks, masks of an outline, and none. Each is judged
as it is, where any finding about lights, encoding or motion is a false alarm, and with one thing wrong at a time. A
fault is found where a finding of its kind is given; corrected lights more than 10 degrees off are wrong ones. "Tells"
counts captures in which shading can tell the fault: a matt surface explains them at least a tenth better without it;
half a turn is told where shadows or an outline show it with the true normals.

    --glossy renders no matt materials, and 16 bits only: what must not be taken for sRGB.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from photonormal.doctor import samples
from photonormal.doctor.frame import LambertianFit, NormalsFrame
from photonormal.doctor.misfit import MisfitPixels
from photonormal.examination import check
from photonormal.geometry import angle_deg, normalised
from photonormal.synth import recipe
from photonormal.synth.lights import draw_lights
from photonormal.synth.materials import draw_coats
from photonormal.synth.params import rng, tensor
from photonormal.synth.scene import Scenes, shaded
from photonormal.synth.stream import render_block
from photonormal.synth.trace import NOWHERE, Geometry
from photonormal.types import Capture, Normals

RELIEFS = ("plate", "plaque", "coin", "tablet", "weave")
KINDS = (*RELIEFS, "object")
RIGS = ("dome", "rings", "stage", "cone", "grid", "box")
GROUND = 0.02  # level of what lies around an object
WRONG_DEG = 10  # nine tenths of corrected lights are nearer to the true ones
TELLS = 0.9  # of a matt surface's misfit with a fault, that is left without it, where shading tells


@dataclass(frozen=True)
class Look:
    """How likely each kind of material is, principled ones first and matt ones last, and bits of the files."""

    materials: tuple[float, ...]
    bits: tuple[int, ...]


USUAL, GLOSSY = Look((0.65, 0, 0, 0, 0, 0.35), (8, 16)), Look((1, 0, 0, 0, 0, 0), (16,))


@dataclass(frozen=True)
class Stored:
    """Pictures (n, h, w, c) as unsigned integers of 8 or 16 bits (`photonormal.types.Images`)."""

    samples: np.ndarray

    @property
    def shape(self) -> tuple[int, ...]:
        return self.samples.shape

    @property
    def dtype(self) -> np.dtype:
        return self.samples.dtype

    def __getitem__(self, j: int, /) -> np.ndarray:
        return self.samples[j].astype(np.float32) / np.float32(np.iinfo(self.dtype).max)


def stored(I: np.ndarray, bits: int) -> Stored:
    """Radiance in [0, 1] as files hold it."""
    top = 2**bits - 1
    return Stored(np.rint(top * I.clip(0, 1)).astype(np.uint8 if bits == 8 else np.uint16))


def waves(g: np.random.Generator, size: int, low: float, high: float) -> np.ndarray:
    """A random height (size, size) of unit deviation, of `low` to `high` waves across the frame."""
    f = np.hypot(*np.meshgrid(*[np.fft.fftfreq(size, 1 / size)] * 2))
    spectrum = (f >= low) * (f <= high) / np.maximum(f, 1) ** 1.2
    z = np.fft.ifft2(spectrum * np.exp(2j * np.pi * g.random((size, size)))).real
    return z / z.std()


def strokes(g: np.random.Generator, size: int, count: int, straight: bool = False) -> np.ndarray:
    """Letters, wedges and lines: depths in [0, 1] of `count` grooves with round or sharp grounds."""
    y, x = np.mgrid[:size, :size].astype(float)
    depth = np.zeros((size, size))
    for _ in range(count):
        (cx, cy), length, width = g.uniform(0.1, 0.9, 2) * size, g.uniform(0.05, 0.25) * size, g.uniform(1.5, 4)
        a = g.integers(0, 4) * np.pi / 4 if straight else g.uniform(0, 2 * np.pi)
        u = (x - cx) * np.cos(a) + (y - cy) * np.sin(a)
        v = (y - cy) * np.cos(a) - (x - cx) * np.sin(a)
        d = np.hypot(np.maximum(np.abs(u) - length / 2, 0), v) / width
        depth = np.maximum(depth, np.exp(-(d**2)) if g.random() < 0.5 else np.maximum(1 - d / 1.6, 0))
    return depth


def relief(kind: str, g: np.random.Generator, size: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Height (size, size) in pixels, and the outline of the thing, or None where it fills the frame."""
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    r = np.hypot(x, y)
    scale = size / 100
    fine = 0.12 * scale * g.random() * waves(g, size, 6, 40)
    if kind == "plate":  # engraved, or of random relief
        z = -g.uniform(0.8, 4) * scale * strokes(g, size, int(g.integers(8, 40)), g.random() < 0.3)
        z += g.uniform(0, 2.5) * scale * waves(g, size, 2, 9) * (g.random() < 0.6)
        return z + fine, None
    if kind == "plaque":  # a raised figure in a frame
        figure = np.tanh(2 * np.maximum(waves(g, size, 1, 5) - g.uniform(-0.5, 0.5), 0))
        z = g.uniform(3, 10) * scale * figure * (1 + 0.2 * waves(g, size, 3, 10))
        border = np.maximum(np.abs(x), np.abs(y))
        if g.random() < 0.6:
            z = np.where(border > 0.8, g.uniform(2, 6) * scale * np.exp(-(((border - 0.88) / 0.05) ** 2)), z)
        return z + fine, np.maximum(np.abs(x), np.abs(y)) < 0.96
    if kind == "coin":
        z = g.uniform(1, 4) * scale * np.maximum(waves(g, size, 2, 9), 0) * (r < 0.72)
        z += g.uniform(1, 4) * scale * strokes(g, size, int(g.integers(5, 25))) * (r < 0.75)
        z += g.uniform(1, 4) * scale / (1 + np.exp(-(0.06 - np.abs(r - 0.82)) / g.uniform(0.006, 0.02)))
        return z + fine, r < 0.9
    if kind == "tablet":  # slightly domed, with wedges
        z = g.uniform(2, 14) * scale * (1 - 0.5 * (x**2 * g.uniform(0.5, 1) + y**2))
        z -= g.uniform(1, 4) * scale * strokes(g, size, int(g.integers(20, 60)), True)
        return z + 2 * fine, (np.abs(x) ** 4 + np.abs(y) ** 4) < 0.85
    a = g.choice([0, 0, np.pi / 4, g.uniform(0, np.pi)])
    f = np.pi * g.uniform(5, 14)
    u, v = f * (x * np.cos(a) + y * np.sin(a)), f * (y * np.cos(a) - x * np.sin(a))
    threads = g.choice(3)
    if threads == 0:
        z = np.maximum(np.abs(np.sin(u)) * np.sign(np.sin(u) * np.sin(v)), 0) + np.abs(np.sin(v)) / 2
    elif threads == 1:
        z = (np.sin(u) + np.sin(v)) / 2
    else:
        z = np.sin(u) * np.sin(v)
    z = g.uniform(0.3, 1.2) * size / f * z + 0.7 * scale * waves(g, size, 2, 8)
    return z + fine, None


def of_relief(kind: str, g: np.random.Generator, size: int, look: Look, distance: float | None = None) -> Capture:
    """A rendered relief under distant lights, or lamps so many half widths away."""
    z, outline = relief(kind, g, size)
    z_y, z_x = np.gradient(z)
    N = normalised(np.stack([-z_x, z_y, np.ones_like(z)], axis=-1))
    height = torch.from_numpy(z).float()[None]
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    geometry = Geometry(
        height,
        torch.from_numpy(N).float().permute(2, 0, 1)[None],
        torch.ones(1, size, size, dtype=torch.bool),
        torch.from_numpy(np.stack([x, -y, z / size])).float()[None],
        torch.full((1, 2, size, size), NOWHERE),
    )
    n = int(g.integers(12, 33))
    L = draw_lights(g, 1, n, 0.0, str(g.choice(RIGS)))
    made = recipe("lambert", size=size, crop=size, shadows=True, distance=distance)
    one = torch.ones(1)
    coats = draw_coats(g, 1, look.materials, 0.5, None)
    bounce = torch.tensor([bool(g.random() < 0.5)])
    scenes = Scenes(None, coats, tensor(L), one, one, bounce, tensor(np.array([0.01 * g.random()])))  # pyright: ignore
    pixels = torch.arange(size * size)[None]
    I = shaded(scenes, geometry, pixels, made, None, int(g.integers(2**31)))[0]  # (n, 3, p)
    I = I.permute(0, 2, 1).reshape(n, size, size, 3).numpy()
    ground = g.choice(["fills", "mask", "dark"]) if outline is not None else "fills"
    mask = drawn_mask(g, size, outline if ground == "mask" else None)
    if outline is not None and ground != "fills":
        I = np.where(outline[..., None], I, GROUND * g.random() * L[0, :, 2, None, None, None])
    if outline is not None and ground == "dark":
        mask = np.ones((size, size), bool)
    return photographed(I, L[0], N, mask, look, g)


def drawn_mask(g: np.random.Generator, size: int, outline: np.ndarray | None) -> np.ndarray:
    """All of the frame, a rectangle, a circle or an ellipse, or the outline of the thing itself."""
    if outline is not None:
        return outline
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    a, b = g.uniform(0.6, 0.95, 2)
    masks = (np.ones((size, size), bool), (np.abs(x) < a) & (np.abs(y) < b), (x / a) ** 2 + (y / b) ** 2 < 1)
    return masks[g.integers(3)]


def photographed(
    I: np.ndarray, L: np.ndarray, N: np.ndarray, mask: np.ndarray, look: Look, g: np.random.Generator
) -> Capture:
    """Exposed so that few samples are white, with noise."""
    I = I / np.quantile(I[:, mask], g.uniform(0.985, 1))
    I = I.clip(0, 1)
    sigma = g.uniform(0.001, 0.008)
    I = I + sigma * np.sqrt(0.1 + 0.9 * I) * g.standard_normal(I.shape)
    bits = int(g.choice(look.bits))
    images = stored(I, bits)
    names = tuple(f"IMG_{j + 1}.png" for j in range(len(L)))
    truth = Normals(np.where(mask[..., None], N, 0).astype(np.float32), mask)
    return Capture(images, mask, L.astype(np.float64), truth, np.ones((len(L), 3)), image_names=names)


def of_objects(seed: int, count: int, size: int, look: Look, distance: float | None = None) -> Iterator[Capture]:
    """Drawn solids of the training set's shapes, with and without a mask."""
    k = done = 0
    while done < count:
        made = recipe(
            "validation", size=size, crop=size, crops=1, zoom=0.0, scenes=8, lights=(12, 32), narrow=0.4,
            materials=look.materials, noise=0.0, saturated=0.0, low_bits=0.0, distance=distance,
        )  # fmt: skip
        batch = render_block(made, 900_000 + seed, k, torch.device("cpu"), 8)
        for I, L, N, on in zip(batch.images, batch.lights, batch.normals, batch.mask, strict=True):
            g = rng(seed, 7, done)
            mask, normals = on[0].numpy(), N.permute(1, 2, 0).numpy()
            capture = photographed(I.permute(0, 2, 3, 1).numpy(), L.numpy(), normals, mask, look, g)
            if g.random() < 0.3:
                capture = replace(capture, mask=np.ones_like(mask))
            yield capture
            if (done := done + 1) == count:
                return
        k += 1


def captures(
    kind: str, seed: int, count: int, size: int, look: Look = USUAL, distance: float | None = None
) -> Iterator[Capture]:
    """`count` right captures of a kind."""
    if kind == "object":
        yield from of_objects(seed, count, size, look, distance)
        return
    for k in range(count):
        yield of_relief(kind, rng(seed, KINDS.index(kind), k), size, look, distance)


def with_lights(change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Callable:
    """A fault of the lights' file."""
    return lambda c, g: replace(c, lights=change(c.lights, g))


def with_pictures(change: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Callable:
    """A fault of the pictures, in [0, 1]; what exceeds 1 is exposed anew."""

    def changed(c: Capture, g: np.random.Generator) -> Capture:
        I = change(np.stack([c.images[j] for j in range(len(c.lights))]), g)
        return replace(c, images=stored(I / max(1.0, float(I.max())), 8 * c.images.dtype.itemsize))

    return changed


def shaken(L: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """Each light beside itself, by 5 degrees in the mean."""
    aside = g.standard_normal(L.shape)
    aside -= (aside * L).sum(1, keepdims=True) * L
    return normalised(L + np.radians(5) / np.sqrt(np.pi / 2) * aside)


def one_moved(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """One picture by 3 to 6 pixels."""
    a, r, j = g.uniform(0, 2 * np.pi), g.uniform(3, 6), int(g.integers(len(I)))
    I[j] = np.roll(I[j], (round(r * np.sin(a)), round(r * np.cos(a))), axis=(0, 1))
    return I


def half_moved(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """The second half of the pictures by 3 pixels, as after a camera was touched."""
    I[len(I) // 2 :] = np.roll(I[len(I) // 2 :], (2, 3), axis=(1, 2))
    return I


def half_turned(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """A third of the pictures by half a turn."""
    I[::3] = np.rot90(I[::3], 2, axes=(1, 2))
    return I


def third_moved(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """Every third picture by one pixel to the right and two up."""
    I[::3] = np.roll(I[::3], (-2, 1), axis=(1, 2))
    return I


def half_quarter_turned(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """The second half of the pictures by a quarter turn."""
    I[len(I) // 2 :] = np.rot90(I[len(I) // 2 :], 1, axes=(1, 2))
    return I


def one_brighter(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """One picture, 1.6 times."""
    return I * np.where(np.arange(len(I)) == g.integers(len(I)), 1.6, 1)[:, None, None, None]


def one_twice(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """One picture under the light of another, of up to a fifth more or less, with noise of its own."""
    i, j = g.permutation(len(I))[:2]
    shown = I[i] + 0.004 * np.sqrt(0.1 + 0.9 * I[i].clip(0)) * g.standard_normal(I[i].shape)
    I[j] = g.uniform(0.8, 1.2) * shown.clip(0)
    return I


def encoded(I: np.ndarray, g: np.random.Generator) -> np.ndarray:
    """As sRGB."""
    return np.where(I <= 0.0031308, 12.92 * I, 1.055 * I ** (1 / 2.4) - 0.055)


FRAMES = {
    "y flipped": NormalsFrame(True, 0).matrix(),
    "x flipped": NormalsFrame(True, 180).matrix(),
    "both flipped": NormalsFrame(False, 180).matrix(),
    "x and y exchanged": NormalsFrame(True, 90).matrix(),
    "quarter turn": NormalsFrame(False, 90).matrix(),
    "z flipped": np.diag([1.0, 1.0, -1.0]),
}
FAULTS = {  # name -> what was done, and the kinds of findings that tell it; new ones come last, since seeds count them
    **{name: (with_lights(lambda L, g, M=M: L @ M.T), {"frame"}) for name, M in FRAMES.items()},
    "order reversed": (with_lights(lambda L, g: L[::-1]), {"order"}),
    "order random": (with_lights(lambda L, g: g.permutation(L)), {"order"}),
    "halfway": (with_lights(lambda L, g: normalised(L + np.array([0, 0, 1]))), {"halfway"}),
    "one light x 1.6": (with_pictures(one_brighter), {"intensities"}),
    "one moved": (with_pictures(one_moved), {"motion"}),
    "half moved": (with_pictures(half_moved), {"motion"}),
    "a third turned": (with_pictures(half_turned), {"turned"}),
    "ambient 0.3": (with_pictures(lambda I, g: I + 0.3 * I.mean(0)), {"ambient", "encoding"}),
    "ambient 1.0": (with_pictures(lambda I, g: I + I.mean(0)), {"ambient", "encoding"}),
    "sRGB": (with_pictures(encoded), {"encoding", "ambient"}),
    "lamps at 2 widths": (None, {"near"}),
    "a third moved": (with_pictures(third_moved), {"motion"}),
    "half turned by a quarter": (with_pictures(half_quarter_turned), {"turned"}),
    "each light off by 5 degrees": (with_lights(shaken), {"lights"}),
    "one light twice": (with_pictures(one_twice), {"repeated"}),
}
JUDGED = {
    "order",
    "frame",
    "repeated",
    "intensities",
    "ambient",
    "encoding",
    "near",
    "halfway",
    "contrast",
    "motion",
    "turned",
    "positions",
    "lights",
}


TOLD_BY_A_MATT_FIT = {"halfway", "ambient", "encoding"}


def matt_misfit(capture: Capture) -> float:
    """What a matt surface leaves of the pictures, as part of a pixel's level."""
    I, mask = samples.on_object(samples.read(capture))
    pixels = MisfitPixels.of(I, mask)
    return 0.0 if pixels is None else float(np.median(pixels.fit(capture.lights)[1]))


def half_turn_told(right: Capture) -> bool:
    """Whether shadows or an outline tell half a turn of the lights where the normals are the true ones."""
    assert right.truth is not None and right.lights is not None
    mask = right.truth.mask
    I, N = samples.read(replace(right, mask=mask)).I, right.truth.map[mask].astype(np.float64)
    b = N * np.median(I / (N @ right.lights.T).clip(0.2), axis=1, keepdims=True)
    surface = LambertianFit(I, b, mask, right.lights)
    votes = [surface.shadows.vote(np.eye(3)), 0.0 if surface.outline is None else surface.outline.vote(np.eye(3))]
    return max(votes) > 0 and min(votes) >= 0


def judged(capture: Capture, fault: str, right: Capture) -> dict[str, Any]:
    """What the doctor says of one capture, which would be `right` without its fault."""
    kinds = FAULTS[fault][1] if fault in FAULTS else set()
    found = [f for f in check(capture) if f.kind in JUDGED]
    off = [float(np.quantile(angle_deg(f.lights, right.lights), 0.9)) for f in found if f.lights is not None]
    tells = True
    if kinds & TOLD_BY_A_MATT_FIT:
        tells = matt_misfit(right) < TELLS * matt_misfit(capture)
    elif fault == "both flipped":
        tells = half_turn_told(right)
    return {
        "tells": tells,
        "found": any(f.kind in kinds for f in found),
        "right": sum(deg <= WRONG_DEG for deg in off),
        "wrong": sum(deg > WRONG_DEG for deg in off),
        "alarms": [] if kinds else [f.kind for f in found],
    }


def main() -> None:
    """Print a table of rates for each kind of capture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=int, default=112)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--faults", default=",".join(["right", *FAULTS]))
    parser.add_argument("--glossy", action="store_true")
    parser.add_argument(
        "--results", type=Path, help="lines of JSON, one a capture; those that are there are not redone"
    )
    args = parser.parse_args()
    torch.set_num_threads(1)
    faults, look = args.faults.split(","), GLOSSY if args.glossy else USUAL
    lines = args.results.read_text().splitlines() if args.results and args.results.exists() else []
    there = {tuple(row.pop("of")): row for row in map(json.loads, lines)}
    print("| captures | fault | count | tells | found | found where told | corrected | wrongly so | false alarms |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in args.kinds.split(","):
        near = (
            captures(kind, args.seed, args.count, args.size, look, 4.0) if "lamps at 2 widths" in faults else iter(())
        )
        rows = {fault: [] for fault in faults}
        for k, capture in enumerate(captures(kind, args.seed, args.count, args.size, look)):
            for fault in faults:
                of = (args.seed, args.size, args.glossy, kind, k, fault)
                change = FAULTS[fault][0] if fault in FAULTS else lambda c, g: c
                g = rng(args.seed, 11, k, (["right", *FAULTS]).index(fault))
                faulty = next(near) if change is None else change(capture, g)
                if of not in there:
                    there[of] = judged(faulty, fault, capture)
                    if args.results:
                        with args.results.open("a") as file:
                            file.write(json.dumps({"of": of, **there[of]}) + "\n")
                rows[fault].append(there[of])
        for fault in faults:
            print(f"| {kind} | {fault} | {line_of(rows[fault], fault)} |", flush=True)


def line_of(rows: list[dict[str, Any]], fault: str) -> str:
    """Figures of one kind of capture with one fault."""

    def count(name: str, among: list[dict[str, Any]] = rows) -> int:
        return sum(row[name] for row in among)

    alarms = Counter(kind for row in rows for kind in row["alarms"])
    found = [count("tells"), count("found"), count("found", [row for row in rows if row["tells"]])]
    told = " ".join(f"{kind} {times}" for kind, times in alarms.items())
    figures = [len(rows), *(found if fault in FAULTS else [""] * 3), count("right"), count("wrong"), told]
    return " | ".join(map(str, figures))


if __name__ == "__main__":
    main()
