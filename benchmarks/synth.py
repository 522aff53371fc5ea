"""How fast scenes are rendered: whole ones under 64 lights with and without the bounce, and the stream that trains.

    python benchmarks/synth.py [--device cpu|cuda|all] [--seconds 20] [--json FILE]

Each figure is the best of three runs; the first, which warms up, is not one of them. PHOTONORMAL_DATA adds measured
materials.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import torch

from photonormal.synth import Rendering, Stream, recipe
from photonormal.synth.stream import render_block

WHOLE = {"crop": 128, "crops": 1, "lights": (64, 64), "varying": 1.0, "zoom": 0.3, "coverage": 0.1}
RUNS = 3


def rate(work: Callable[[int], int], device: torch.device, budget: float) -> tuple[float, float]:
    """Samples a second and samples a second of one processor, best of RUNS.

    `work(k)` makes its k-th samples and returns how many. On a machine that others use, too, only the second figure
    says something.
    """
    work(0)
    rates, per_core, k = [], [], 1
    for _ in range(RUNS):
        done, start, busy = 0, time.perf_counter(), time.process_time()
        while time.perf_counter() - start < budget / RUNS:
            done += work(k)
            k += 1
            if device.type == "cuda":
                torch.cuda.synchronize()
        rates.append(done / (time.perf_counter() - start))
        per_core.append(done / (time.process_time() - busy))
    return max(rates), max(per_core)


def whole(changes: dict, device: torch.device) -> Callable[[int], int]:
    """Scenes of 128 x 128 pixels under 64 lights."""
    scenes = 16 if device.type == "cpu" else 64
    made: Rendering = recipe("train", **{**WHOLE, **changes, "scenes": scenes})
    return lambda k: len(render_block(made, 0, k, device, scenes).mask)


def windows(changes: dict, device: torch.device) -> Callable[[int], int]:
    """A block of the training stream: windows of 32 x 32 pixels under 32 lights."""
    scenes = 16 if device.type == "cpu" else 64
    stream = Stream("train", 32, device, 0, scenes=scenes, **changes)

    def block(k: int) -> int:
        return len(render_block(stream.recipe_of(k), 0, k, device, scenes * stream.recipe_of(k).crops).mask)

    return block


CASES = {
    "scenes 128 x 128, 64 lights, varying, shadows, bounce": (whole, {"bounce": 1.0}),
    "  without the bounce": (whole, {"bounce": 0.0}),
    "  without bounce and cast shadows": (whole, {"bounce": 0.0, "shadows": False}),
    "windows 32 x 32, 32 lights, as trained on": (windows, {}),
    "  64 lights": (windows, {"lights": (64, 64)}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="all", choices=["cpu", "cuda", "all"])
    parser.add_argument("--seconds", type=float, default=20.0, help="for each figure")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    names = ["cpu", "cuda"] if args.device == "all" else [args.device]
    devices = [torch.device(name) for name in names if name == "cpu" or torch.cuda.is_available()]
    found: dict[str, dict[str, dict[str, float]]] = {}
    for device in devices:
        what = torch.cuda.get_device_name() if device.type == "cuda" else f"{torch.get_num_threads()} threads"
        print(f"{device.type} ({what})")
        for name, (case, changes) in CASES.items():
            r, core = rate(case(changes, device), device, args.seconds)
            found.setdefault(device.type, {})[name.strip()] = {"per_second": r, "per_core_second": core}
            print(f"  {name:56s}{r:8.1f} /s {core:8.1f} /s of one processor", flush=True)
    if args.json:
        args.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
