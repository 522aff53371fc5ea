"""Seconds and memory to read a capture, beside decoding the same files with OpenCV in as many threads as cores.

    python benchmarks/reading.py [--runs 5] [FOLDER ...]

Without folders: 96 synthetic 16-bit colour pictures of 512 x 612 pixels, and the DiLiGenT objects in PHOTONORMAL_DATA,
if that is set. Both sides run in turns, each time in a fresh process; the fastest run counts. Reading gives linear
radiance divided by the intensity of the light and keeps the decoded box around the mask; OpenCV's pictures are thrown
away.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

import photonormal as pn
import photonormal.capture.diligent  # imports are no part of the seconds
from photonormal.resources import cores


def write_capture(folder: Path, n: int = 96, h: int = 512, w: int = 612) -> None:
    """A shaded ball with noise in the layout of DiLiGenT."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[h / 2 : -h / 2 : 1j * h, -w / 2 : w / 2 : 1j * w] / (0.45 * h)
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    lights = np.stack([*rng.uniform(-0.7, 0.7, (2, n)), np.ones(n)], axis=-1)
    names = [f"{j + 1:03d}.png" for j in range(n)]
    for name, (a, b, c) in zip(names, lights, strict=True):
        shaded = np.where(z > 0, np.maximum(a * x + b * y + c * z, 0), 0)[..., None] * [0.2, 0.3, 0.4]
        picture = np.clip(65535 * shaded + rng.normal(100, 60, (h, w, 3)), 0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / name), picture)
    (folder / "filenames.txt").write_text("\n".join(names))
    np.savetxt(folder / "light_directions.txt", lights)
    np.savetxt(folder / "light_intensities.txt", np.ones((n, 3)))
    cv2.imwrite(str(folder / "mask.png"), (z > 0).astype(np.uint8) * 255)


def read(folder: Path) -> None:
    """Every picture as linear radiance, as `measure` reads it."""
    pn.load(folder).map_images(lambda j, image: None)


def decode(folder: Path) -> None:
    """Every picture decoded by OpenCV."""
    files = [str(folder / name) for name in (folder / "filenames.txt").read_text().split()]
    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(lambda file: cv2.imread(file, cv2.IMREAD_UNCHANGED) is None, files))


SIDES = {"read": read, "decode": decode}


def run_once(side: str, folder: Path) -> None:
    """Print the seconds, the processor seconds and the peak memory in MB of one run."""
    baseline, started, used = peak_mb(), time.perf_counter(), time.process_time()
    SIDES[side](folder)
    print(time.perf_counter() - started, time.process_time() - used, peak_mb(), peak_mb() - baseline)


def peak_mb() -> float:
    """Largest resident size of this process so far; `getrusage` would count the parent's."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def measured(folder: Path, runs: int) -> dict[str, np.ndarray]:
    """Least seconds, processor seconds, peak memory and what of it came with the reading, in MB, of both sides."""
    results = {side: [] for side in SIDES}
    for _ in range(runs):
        for side in SIDES:
            command = [sys.executable, __file__, "--once", side, str(folder)]
            results[side].append([float(v) for v in subprocess.check_output(command, text=True).split()])
    return {side: np.min(rows, axis=0) for side, rows in results.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--once", choices=SIDES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.once:
        run_once(options.once, options.folders[0])
        return
    with tempfile.TemporaryDirectory() as temporary:
        folders = options.folders
        if not folders:
            write_capture(Path(temporary))
            data = os.environ.get("PHOTONORMAL_DATA")
            folders = [Path(temporary), *(sorted(Path(data).glob("diligent/pmsData/*PNG")) if data else [])]
        print(f"{cores()} cores, fastest of {options.runs} runs\n")
        print("| capture | pictures | read s | OpenCV s | ratio | ratio of processor s | peak MB | OpenCV peak MB |")
        print("|---|---|---|---|---|---|---|---|")
        for folder in folders:
            name = "synthetic 612 x 512" if str(folder) == temporary else folder.name
            n = pn.load(folder).images.shape[0]
            result = measured(folder, options.runs)
            (ours, our_work, peak, added), (theirs, their_work, their_peak, _) = result["read"], result["decode"]
            print(
                f"| {name} | {n} | {ours:.3f} | {theirs:.3f} | {ours / theirs:.2f} | {our_work / their_work:.2f} "
                f"| {peak:.0f}, {added:.0f} of it for reading | {their_peak:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
