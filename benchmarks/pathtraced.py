"""The training renderer against Mitsuba 3 on the same scenes, as a Markdown table; pictures side by side on request.

    python benchmarks/pathtraced.py [--meshes FOLDER] [--pictures FOLDER] [--lights 6] [--size 128] [--samples 64]
        [--bounces 1]

Both render the same object under the same lights. Errors are means over the images of the mean absolute difference over
the mean value, on the pixels that light reaches in both; shadows are compared on pixels at least one away from edges.
Both see the same triangles, of which Mitsuba has all and the training renderer three heights a pixel. The last columns
compare the surface that the training renderer marches to by itself; the triangles of fine detail differ from it, too.
"""

from __future__ import annotations

import argparse
import re
import time
from pathlib import Path

import numpy as np

from photonormal.synth.meshes import STATUE
from photonormal.synth.pathtraced.compare import BothRenderings, compare
from photonormal.synth.pathtraced.meshes import read_mesh
from photonormal.synth.pathtraced.objects import bowl, sphere, turtle
from photonormal.synth.sculptor import KINDS

MATT = np.array([0.8, 0.7, 0.6, 0, 1, 0, 0, 0, 0, 0, 0.0])  # principled parameters
METAL = np.array([0.9, 0.7, 0.4, 1, 0.4, 0.5, 0, 0, 0, 0, 0])
PLASTIC = np.array([0.7, 0.2, 0.15, 0, 0.35, 0.8, 0, 0, 0, 0, 0])
COATED = np.array([0.3, 0.4, 0.6, 0, 0.6, 0.4, 0.5, 0.3, 0.5, 0.8, 0.5])
COLOUR = {"type": "rgb", "value": [0.8, 0.7, 0.6]}
STOCK = {  # materials of Mitsuba's own, compared with the same parameters of ours
    "diffuse": (MATT[:3], {"type": "diffuse", "reflectance": COLOUR}),
    "principled, matt": (MATT, {"type": "principled", "base_color": COLOUR, "roughness": 1.0, "specular": 0.0}),
    "principled, metal": (
        METAL,
        {"type": "principled", "base_color": {"type": "rgb", "value": METAL[:3].tolist()},
         "roughness": 0.4, "metallic": 1.0},
    ),
    "principled, plastic": (
        PLASTIC,
        {"type": "principled", "base_color": {"type": "rgb", "value": PLASTIC[:3].tolist()},
         "roughness": 0.35, "specular": 0.8},
    ),
}  # fmt: skip


def row(c: BothRenderings, seconds: float) -> str:
    """One line of the table."""
    return (
        f"| {c.name} | {int(c.mask.sum())} | {c.direct_percent():.2f} "
        f"| {c.bounced_percent():.2f} | {c.indirect_ratio():.2f} | {c.shadows_percent():.2f} "
        f"| {c.normals_deg():.2f} | {c.marched_percent():.2f} | {seconds:.0f} |"
    )


def picture(c: BothRenderings, path: Path) -> None:
    """Rows of lights: ours, Mitsuba's, four times the difference, ours and Mitsuba's light of the bounce alone."""
    import cv2

    rows = []
    for j in range(0, len(c.lights), max(1, len(c.lights) // 3)):
        a, b = (images[j] * c.mask[..., None] for images in c.bounced)
        scale = np.quantile(b[c.mask], 0.99)
        bounce = [(whole[j] - direct[j]) * c.mask[..., None] for whole, direct in zip(c.bounced, c.direct, strict=True)]
        difference = 0.5 + 2 * (a - b) / scale
        most = np.quantile(bounce[1][c.mask], 0.98) + 1e-6
        cells = [a / scale, b / scale, None, bounce[0] / most, bounce[1] / most]
        shown = [np.clip(difference if x is None else np.clip(x, 0, 1) ** (1 / 2.2), 0, 1) for x in cells]
        rows.append(np.concatenate(shown, 1))
    sheet = (np.concatenate(rows, 0)[..., ::-1] * 255).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(sheet, None, fx=1.5, fy=1.5, interpolation=cv2.INTER_NEAREST))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, help="folder of meshes, for the statue")
    parser.add_argument("--pictures", type=Path, help="folder for pictures side by side")
    parser.add_argument("--lights", type=int, default=6)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--bounces", type=int, default=1, help="in the path tracer; the training renderer has its own")
    parser.add_argument("--only", help="part of the names of the scenes to render")
    arguments = parser.parse_args()
    scenes: dict[str, dict] = {f"{kind}, varying": {"kind": kind, "seed": 1} for kind in KINDS}
    scenes |= {f"{kind}, matt": {"kind": kind, "seed": 2, "material": MATT} for kind in KINDS[1:4]}
    objects = {"turtle": turtle()}
    if arguments.meshes:
        objects["nefertiti"] = read_mesh(arguments.meshes / STATUE).fitted()
    for name, mesh in objects.items():
        materials = {"matt": MATT, "plastic": PLASTIC, "metal": METAL, "coated": COATED}
        scenes |= {f"{name}, {what}": {"kind": mesh, "material": values} for what, values in materials.items()}
        scenes[f"{name}, varying"] = {"kind": mesh, "seed": 3}
    scenes |= {f"pleats {seed}, metal": {"kind": "pleated", "seed": seed, "material": METAL} for seed in (1, 2, 3, 4)}
    scenes["bowl, metal"] = {"kind": bowl(), "material": METAL}
    scenes["bowl, Mitsuba's diffuse"] = {"kind": bowl(), "material": MATT[:3]}
    scenes |= {
        f"sphere, Mitsuba's {what}": {"kind": sphere(), "material": values, "stock": stock}
        for what, (values, stock) in STOCK.items()
    }
    print(
        "| scene | pixels | direct (%) | with bounce (%) | bounced light, ours / Mitsuba's | shadows agree (%) "
        "| own normals (deg) | direct on own surface (%) | seconds |\n|---|---|---|---|---|---|---|---|---|"
    )
    for title, options in scenes.items():
        if arguments.only and arguments.only not in title:
            continue
        started = time.perf_counter()
        c = compare(
            name=title,
            n=arguments.lights,
            size=arguments.size,
            samples=arguments.samples,
            bounces=arguments.bounces,
            **options,
        )
        print(row(c, time.perf_counter() - started), flush=True)
        if arguments.pictures:
            arguments.pictures.mkdir(parents=True, exist_ok=True)
            picture(c, arguments.pictures / f"path-tracer-{re.sub('[^a-z]+', '-', title.lower())}.png")


if __name__ == "__main__":
    main()
