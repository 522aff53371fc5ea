"""Speed of the learned methods: samples a second of a training step, seconds and memory of a measurement.

    python benchmarks/network.py train paper [--batch 4] [--device cuda]
    python benchmarks/network.py measure lambertian-prior [--side 300] [--images 10 96 300]

`train` prints the share of the device's peak (the fastest large matrix product in the numbers that training uses) and
how many samples a second the renderer makes. `measure` runs each number of images in a process of its own, with a
network of random weights, on a disc in pictures that are made when they are asked for.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import torch

from photonormal.geometry import fibonacci_hemisphere
from photonormal.methods.engine.device import torch_device
from photonormal.methods.engine.stream import measured
from photonormal.methods.learned.network import placed
from photonormal.methods.learned.processor import inner_precision, keep_freed_memory, knows_bf16
from photonormal.methods.learned.weights import build
from photonormal.train.observe import observe
from photonormal.train.recipes import recipe
from photonormal.types import Capture


class Pictures:
    """`n` pictures (side, side, 3) that exist only while they are looked at."""

    def __init__(self, n: int, side: int) -> None:
        self.shape = (n, side, side, 3)
        self.one = np.random.default_rng(0).random((side, side, 3), np.float32)

    def __getitem__(self, j: int) -> np.ndarray:
        return np.roll(self.one, j, axis=0)


def seconds(f, device: torch.device, repeat: int = 3) -> float:
    """The best of several runs, after one that is not counted."""
    best = float("inf")
    for i in range(repeat + 1):
        start = time.perf_counter()
        f()
        if device.type == "cuda":
            torch.cuda.synchronize()
        best = min(best, time.perf_counter() - start) if i else best
    return best


def peak(device: torch.device) -> float:
    """Floating-point operations a second of a large matrix product."""
    n = 8192 if device.type == "cuda" else 2048
    a = torch.randn(n, n, device=device, dtype=torch.bfloat16 if knows_bf16(device.type) else torch.float32)
    return 2 * n**3 / seconds(lambda: a @ a, device, 10)


def train(name: str, batch: int, device: torch.device) -> None:
    """One training step, taken apart."""
    from torch.utils.flop_counter import FlopCounterMode

    from photonormal.synth import Stream

    keep_freed_memory()
    r = recipe(name)
    r = replace(r, batch=batch or r.batch)
    stream = iter(Stream(r.stream, r.batch, device, 0, lights=(r.images[1],) * 2, **r.rendering))
    drawn = next(stream)
    start, count = time.perf_counter(), 0
    while time.perf_counter() - start < 20:
        drawn = next(stream)
        count += r.batch
    rendered = count / (time.perf_counter() - start)
    net = placed(build(r.network, r.config), device)
    optimiser = torch.optim.Adam(net.parameters(), fused=device.type == "cuda")

    def step() -> None:
        seen = observe(drawn, r, net.scaling, 0, vary=False)
        with inner_precision(device):
            N = net(seen.images, seen.lights, seen.prior)
        optimiser.zero_grad()
        ((1 - (N * seen.normals).sum(1)) * seen.mask[:, 0]).mean().backward()
        optimiser.step()

    with FlopCounterMode(display=False) as counter:
        step()
    took, best = seconds(step, device), peak(device)
    flop = counter.get_total_flops()
    print("| recipe | device | batch x images | GFLOP a sample | samples/s | share of peak | rendered samples/s |")
    print("|---|---|---|---|---|---|---|")
    print(
        f"| {name} | {device.type}, {torch.get_num_threads()} threads | {r.batch} x {r.images[1]} "
        f"| {flop / r.batch / 1e9:.1f} | {r.batch / took:.1f} | {100 * flop / took / best:.0f} % of "
        f"{best / 1e12:.2f} TFLOP/s | {rendered:.1f} |"
    )


def one(name: str, config: dict, side: int, n: int, device: torch.device, tile: int) -> None:
    """One measurement; prints seconds and peak memory (GB)."""
    y, x = np.mgrid[-1 : 1 : 1j * side, -1 : 1 : 1j * side]
    capture = Capture(Pictures(n, side), x**2 + y**2 < 1, fibonacci_hemisphere(n))
    start = time.perf_counter()
    measured(build(name, config), capture, device, side=tile)
    took = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    if device.type == "cuda":
        memory = torch.cuda.max_memory_allocated() / 2**30
    print(json.dumps({"n": n, "seconds": took, "memory_gb": memory}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["train", "measure", "one"])
    parser.add_argument("name")
    parser.add_argument("--batch", type=int, default=0)
    parser.add_argument("--config", type=json.loads, default={}, help="fields of the network's config, as JSON")
    parser.add_argument("--side", type=int, default=300)
    parser.add_argument("--images", type=int, nargs="+", default=[10, 96, 300])
    parser.add_argument("--tile", type=int, default=0)
    parser.add_argument("--device", default="auto")
    a = parser.parse_args()
    device = torch_device(a.device)
    if a.what == "train":
        train(a.name, a.batch, device)
    elif a.what == "one":
        one(a.name, a.config, a.side, a.images[0], device, a.tile)
    else:
        print("| network | pixels | images | seconds | peak memory |\n|---|---|---|---|---|")
        for n in a.images:
            options = ["--side", str(a.side), "--images", str(n), "--tile", str(a.tile), "--device", a.device]
            command = [sys.executable, __file__, "one", a.name, "--config", json.dumps(a.config), *options]
            found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            pixels = f"{a.side} x {a.side}"
            print(f"| {a.name} | {pixels} | {n} | {found['seconds']:.1f} | {found['memory_gb']:.2f} GB |", flush=True)


if __name__ == "__main__":
    main()
