"""Large captures, made here and measured in a process of their own: what a measurement takes in time, memory and disk.

    python benchmarks/large.py [--megapixels 24] [--images 48] [--format jpg] [--method trimmed] [--memory 2GB]
        [--materials]

Two scenes: a relief that fills the frame, and a turned object before black, about half as large. JPEGs have 8 bits,
TIFFs (`--format tif`) 16 and no compression. Where the disk holds fewer images than were asked for, as many as it holds
are made, which is said. Seconds are those of the clock, and those of all processor cores, which other work on the
machine changes little. Peak memory is the system's own account of the process (VmHWM), of which Linux tells each
stage's, too. Decodes: how many files were decoded, over the number of pictures.
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

import photonormal as pn

SPARE = 8 * 2**30  # bytes of the disk that captures leave free, for a scratch file and the results
BANDS = 256  # rows that are rendered at a time
WAVES = 24  # of the relief
SCENES = ("relief", "turned")


def lights(n: int) -> np.ndarray:
    """(n, 3) unit, spread evenly over the part of the sky that is less than 65 degrees from the view."""
    z = 1 - (np.arange(n) + 0.5) / n * (1 - np.cos(np.radians(65)))
    angle = np.arange(n) * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=-1)


def relief_slopes(rows: np.ndarray, h: int, w: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """dz/dx and dz/dy (y up) of waves of all lengths, and the mask, of some rows."""
    random = np.random.default_rng(3)
    x, y = np.arange(w, dtype=np.float32), -rows.astype(np.float32)[:, None]
    p, q = np.zeros((2, len(rows), w), np.float32)
    for length, angle, phase in zip(
        np.geomspace(w / 2, 12, WAVES), *random.uniform(0, 2 * np.pi, (2, WAVES)), strict=True
    ):
        kx, ky = 2 * np.pi / length * np.array([np.cos(angle), np.sin(angle)])
        s = np.cos(np.float32(kx) * x + np.float32(ky) * y + np.float32(phase)) * np.float32(0.5 / np.sqrt(WAVES))
        p, q = p + np.float32(np.cos(angle)) * s, q + np.float32(np.sin(angle)) * s
    return p, q, np.ones((len(rows), w), bool)


def turned_slopes(rows: np.ndarray, h: int, w: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of a body of revolution about an upright axis: z = sqrt(r(y)^2 - x^2)."""
    t = ((rows + 0.5) / h)[:, None]
    r = (
        min(h, w)
        * (0.27 + 0.1 * np.sin(9 * t) + 0.03 * np.sin(40 * t))
        * np.sqrt(np.clip(1 - (2.1 * t - 1.05) ** 8, 0, 1))
    )
    turn = min(h, w) / h * (0.9 * np.cos(9 * t) + 1.2 * np.cos(40 * t))  # dr/drow, but at the ends
    x = np.arange(w) - (w - 1) / 2
    z = np.sqrt(np.maximum(r**2 - x**2, (0.02 * r) ** 2)).clip(1)
    mask = (np.abs(x) < 0.999 * r) & (r > 0.01 * w)
    return (-x / z).astype(np.float32), (-r * turn / z).astype(np.float32), mask


def normals(scene: str, h: int, w: int, dtype: type) -> tuple[np.ndarray, np.ndarray]:
    """Exact normals (h, w, 3) and the mask."""
    N, mask = np.zeros((h, w, 3), dtype), np.zeros((h, w), bool)
    for y in range(0, h, BANDS):
        rows = np.arange(y, min(y + BANDS, h))
        p, q, mask[rows] = {"relief": relief_slopes, "turned": turned_slopes}[scene](rows, h, w)
        length = np.sqrt(p * p + q * q + 1)
        N[rows] = np.stack([-p / length, -q / length, 1 / length], axis=-1)
    return N, mask


def render(folder: Path, scene: str, h: int, w: int, n: int, suffix: str) -> None:
    """A capture as a folder: a painted surface with a soft highlight, without cast shadows."""
    folder.mkdir(parents=True)
    L = lights(n).astype(np.float32)
    dtype, full = (np.uint8, 255) if suffix == "jpg" else (np.uint16, 65535)
    N, mask = normals(scene, h, w, np.float16)
    paint = np.zeros((h, w, 3), np.uint8)
    for y in range(0, h, BANDS):
        rows = np.arange(y, min(y + BANDS, h))
        stripes = np.sin(rows[:, None] / 97.0 + np.arange(w) / 61.0)
        paint[rows] = 255 * np.stack([0.5 + 0.2 * stripes, 0.4 - 0.1 * stripes, 0.35 + 0 * stripes], axis=-1)
    for j, light in enumerate(L):
        picture = np.zeros((h, w, 3), dtype)
        half = light + np.array([0, 0, 1], np.float32)
        half /= np.linalg.norm(half)
        for y in range(0, h, BANDS):
            part = N[y : y + BANDS].astype(np.float32)
            matt, shine = np.maximum(part @ light, 0)[..., None], np.maximum(part @ half, 0)[..., None] ** 32
            level = paint[y : y + BANDS] / np.float32(255) * matt + 0.15 * shine * (matt > 0)
            picture[y : y + BANDS] = full * (level * mask[y : y + BANDS, :, None]).clip(0, 1)
        quality = [cv2.IMWRITE_JPEG_QUALITY, 93] if suffix == "jpg" else [cv2.IMWRITE_TIFF_COMPRESSION, 1]
        cv2.imwrite(str(folder / f"{j:03}.{suffix}"), picture[..., ::-1], quality)
    cv2.imwrite(str(folder / "mask.png"), mask.astype(np.uint8) * 255)
    np.savetxt(folder / "light_directions.txt", L)


def fitting(images: int, h: int, w: int, suffix: str, folder: Path) -> int:
    """How many images the disk holds, up to `images`, each as a file and in the scratch file; says so where fewer."""
    file, decoded = (h * w * 3 // 4, h * w * 3) if suffix == "jpg" else (h * w * 6, h * w * 6)
    free = shutil.disk_usage(folder).free - SPARE
    held = min(images, free // (file + decoded))
    if held < 3:
        raise SystemExit(f"{folder} has no room for three pictures of {h} x {w}; choose another --folder.")
    if held < images:
        print(f"{folder} holds {held} images and their scratch file, not {images}: so many are made.")
    return int(held)


class Stages:
    """Seconds of the clock and of the processor, and peak memory, of each stage of a measurement in this process."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.processor: dict[str, float] = {}
        self.peak_mb: dict[str, float] = {}
        self.most_mb = 0.0  # between stages, too

    @contextmanager
    def stage(self, name: str, seconds: dict[str, float]) -> Iterator[None]:
        """In place of `photonormal.measurement._stage`."""
        self.most_mb = max(self.most_mb, _peak_mb())
        _forget_peak()
        start, used = time.perf_counter(), time.process_time()
        yield
        seconds[name] = self.seconds[name] = round(self.seconds.get(name, 0) + time.perf_counter() - start, 2)
        self.processor[name] = round(self.processor.get(name, 0) + time.process_time() - used, 2)
        self.peak_mb[name] = max(self.peak_mb.get(name, 0), _peak_mb())
        self.most_mb = max(self.most_mb, self.peak_mb[name])


def processor_seconds() -> float:
    """Of all children so far, in all threads."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _forget_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:  # another system: peaks are of the whole process so far
        pass


def _peak_mb() -> float:
    try:
        line = next(s for s in Path("/proc/self/status").read_text().splitlines() if s.startswith("VmHWM"))
        return int(line.split()[1]) * 1.024e-3
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1.024e-3


def measured(capture: str, arguments: argparse.Namespace) -> None:
    """In the child: measure one capture, write its results, and print what that took as JSON."""
    import photonormal.capture.images as images
    from photonormal.capture.store import scratch_nbytes
    from photonormal.export.folder import whole_folder
    from photonormal.export.result import write_result

    decodes, decode = [], images.decode
    images.decode = lambda path, *frame: (decodes.append(path), decode(path, *frame))[1]
    stages = Stages()
    sys.modules[pn.measure.__module__]._stage = stages.stage
    loaded = pn.load(capture, memory=arguments.memory)
    with tempfile.TemporaryDirectory(dir=arguments.folder) as out:
        result = pn.measure(loaded, arguments.method, integration=arguments.integration, materials=arguments.materials)
        with stages.stage("export", {}), whole_folder(Path(out) / "result") as batch:
            report = write_result(result, batch)
        written = sum(report["files"].values())
    store = loaded.images._kept.store
    told = {
        "pixels": report["pixels"]["mask"],
        "seconds": stages.seconds,
        "processor": stages.processor,
        "peak_mb": stages.peak_mb,
        "most_mb": stages.most_mb,
        "decodes": len(decodes) / loaded.images.shape[0],
        "scratch_mb": 0 if store.in_memory else scratch_nbytes(store.shape, store.dtype) / 1e6,
        "results_mb": written / 1e6,
        "warnings": report["warnings"],
    }
    print(json.dumps(told))


def integrated(scene: str, arguments: argparse.Namespace) -> None:
    """In the child: depth of a scene's exact normals, and what that took as JSON."""
    N, mask = normals(scene, *frame(arguments.megapixels), np.float32)
    given, stages = pn.Normals(N * mask[..., None], mask), Stages()
    del N
    with stages.stage("integrate", {}):
        pn.integrate(given, arguments.integration)
    told = {"seconds": stages.seconds, "processor": stages.processor, "peak_mb": stages.peak_mb}
    print(json.dumps({"pixels": int(mask.sum())} | told))


def frame(megapixels: float) -> tuple[int, int]:
    """Rows and columns, as 2 to 3."""
    w = round(np.sqrt(megapixels * 1e6 * 3 / 2) / 8) * 8
    return round(megapixels * 1e6 / w), w


def child(what: str | Path) -> dict:
    """What a process of its own tells of a capture, or of a scene."""
    process = subprocess.run([sys.executable, __file__, *sys.argv[1:], "--child", what], stdout=subprocess.PIPE)
    if process.returncode:
        raise SystemExit(process.returncode)
    return json.loads(process.stdout)


def print_stages(title: str, told: dict) -> None:
    print(f"\n{title}, {told['pixels']} pixels on the mask")
    print("| stage | s | s (processor) | peak MB |\n|---|---|---|---|")
    for stage, seconds in told["seconds"].items():
        print(
            f"| {stage} | {seconds:.1f} | {told['processor'][stage]:.1f} | {told['peak_mb'][stage]:.0f} |", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megapixels", type=float, default=24)
    parser.add_argument("--images", type=int, default=48)
    parser.add_argument("--format", choices=("jpg", "tif"), default="jpg")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=SCENES)
    parser.add_argument("--method", default="trimmed")
    parser.add_argument("--integration", default="quadratic")
    parser.add_argument("--materials", action="store_true", help="roughness and metalness, too")
    parser.add_argument("--exact", action="store_true", help="integrate exact normals alone, without photographs")
    parser.add_argument("--memory", default="2GB", help="what photonormal is told to stay within")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()), help="where captures are made")
    parser.add_argument("--keep", action="store_true", help="leave the captures there, for the next run")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        (integrated if arguments.exact else measured)(arguments.child, arguments)
        return
    h, w = frame(arguments.megapixels)
    for scene in arguments.scene:
        if arguments.exact:
            print_stages(f"{scene}: {w} x {h}, {arguments.integration}", child(scene))
        else:
            photographed(scene, h, w, arguments)


def photographed(scene: str, h: int, w: int, arguments: argparse.Namespace) -> None:
    """Make a capture where there is none yet, measure it, print the figures."""
    n, called = arguments.images, f"large-{scene}-{h}x{w}x{{}}-{arguments.format}"
    if not (arguments.folder / called.format(n)).exists():
        n = fitting(n, h, w, arguments.format, arguments.folder)
    folder = arguments.folder / called.format(n)
    if not folder.exists():
        render(folder, scene, h, w, n, arguments.format)
    before = processor_seconds()
    try:
        told = child(folder)
    finally:
        if not arguments.keep:
            shutil.rmtree(folder)
    print_stages(f"{scene}: {w} x {h} x {n} {arguments.format}, {arguments.method}", told)
    print(
        f"all stages {sum(told['seconds'].values()):.1f} s, processor of the process "
        f"{processor_seconds() - before:.1f} s, peak {told['most_mb']:.0f} MB; {told['decodes']:g} decodes a picture; "
        f"scratch {told['scratch_mb']:.0f} MB, results {told['results_mb']:.0f} MB"
    )
    for warning in told["warnings"]:
        print(f"  warning: {warning}")


if __name__ == "__main__":
    main()
