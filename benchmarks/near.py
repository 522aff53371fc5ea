"""Near lights: rendered scenes under lamps at several distances, solved as near and as distant, beside distant lights.

    python benchmarks/near.py [--scenes 4] [--size 64] [--lights 32]

Prints the mean angular error in degrees, over the scenes, of each method. A distance is that of the lamps from the
object's middle, in widths of the frame. The scenes are the same at each distance; cast shadows fall from where lamps
are. "Depth known" is solved on the integral of the true normals: what remains there is shadow and shine, of which
near lamps make more or less than distant ones do, and the jumps that no integral knows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import torch

from photonormal import Capture, Normals, solve
from photonormal.methods import configure
from photonormal.methods.engine import on_mask, run
from photonormal.methods.engine.near import surface_mm, without_fall_off
from photonormal.scoring import score
from photonormal.synth import recipe
from photonormal.synth.stream import render_block
from photonormal.types import Camera, Lamps

MATT = {"materials": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}
CASES = {  # changes of the recipe "lambert"
    "matt, smooth, convex": {},
    "matt, any shape, cast shadows": {"shapes": (0.2, 0.2, 0.2, 0.2, 0.1, 0.1, 0.0, 0.0), "shadows": True},
    "any material, cast shadows": {"materials": (1.0, 0, 0, 0, 0, 0), "shadows": True},
}
WIDTHS = (1.0, 1.5, 3.0)
METHODS = ("normalnet", "woodham", "trimmed", "ransac")
WIDTH_MM = 100.0


def captures(case: dict, scenes: int, size: int, lights: int, widths: float | None) -> list[Capture]:
    """Scenes of a recipe under distant lights (None), or under lamps."""
    distance = None if widths is None else 2 * widths  # in half widths
    made = recipe("lambert", size=size, crop=size, lights=(lights, lights), scenes=scenes, distance=distance, **case)
    batch = render_block(made, 0, 0, torch.device("cpu"), scenes)
    found = []
    for I, L, N, mask in zip(batch.images, batch.lights, batch.normals, batch.mask, strict=True):
        on = mask[0].numpy()
        capture = Capture(
            I.permute(0, 2, 3, 1).numpy(),
            on,
            L.numpy(),
            truth=Normals(N.permute(1, 2, 0).numpy(), on),
        )
        if widths is not None:
            lamps = Lamps(widths * WIDTH_MM * L.numpy())
            capture = replace(capture, lamps=lamps, camera=Camera(WIDTH_MM / size))
        found.append(capture)
    return found


def mean_deg(captures: list[Capture], solved: Callable[[Capture], Normals]) -> float:
    """Over the captures, of each one's mean."""
    errors = [score(solved(c), c.truth).mean_deg for c in captures if c.truth is not None]
    return sum(errors) / len(errors)


def depth_known(capture: Capture, method: str) -> Normals:
    """The method where the true normals' integral tells where the surface lies."""
    assert capture.truth is not None
    seen = without_fall_off(capture, surface_mm(capture, capture.truth))
    return on_mask(run(configure(method), seen, torch.device("cpu")), capture)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=4)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--lights", type=int, default=32)
    args = parser.parse_args()
    print("| scenes | method | distant lights | lamps at | as near | depth known | as distant |")
    print("|---|---|---|---|---|---|---|")
    for name, case in CASES.items():
        far = captures(case, args.scenes, args.size, args.lights, None)
        best = {method: mean_deg(far, partial(solve, method=method, device="cpu")) for method in METHODS}
        for widths in WIDTHS:
            near = captures(case, args.scenes, args.size, args.lights, widths)
            for method in METHODS:
                here = partial(solve, method=method, device="cpu")
                known = mean_deg(near, partial(depth_known, method=method))
                distant = mean_deg([replace(c, lamps=None) for c in near], here)
                errors = f"{mean_deg(near, here):.2f} | {known:.2f} | {distant:.2f}"
                print(f"| {name} | {method} | {best[method]:.2f} | {widths:g} widths | {errors} |", flush=True)


if __name__ == "__main__":
    main()
