"""Stored files changed at random, and what photonormal makes of them.

    python -m tests.fuzz.stored_files [--cases 2000] [--seed 0]

Result folders for `score` and `integrate`, runs folders for `table`, `report` and `figure`, weights for `measure`,
journals and checkpoints of trainings, and files of options. Each case is one file changed; a command reads it.
"""

from __future__ import annotations

import random
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.fuzz.change import changed
from tests.fuzz.drive import Driver, campaign

CAPTURE = "root/pmsData/ballPNG"
WEIGHTS = "training/lambertian-prior.safetensors"
KINDS = {  # kind of file -> patterns of what a case may change, commands that read it
    "runs": (
        ("runs/**/*",),
        (
            *("table runs", "table runs --json", "report runs --out out/r.html --no-surfaces"),
            *("figure errors runs --out out", "figure images runs --out out"),
        ),
    ),
    "journal": (("training/journal.jsonl",), ("figure convergence training --out out",)),
    "result": (
        ("result/normals.npz", "result/report.json"),
        (f"score {CAPTURE} result", "integrate result --out out/m.ply", "convert result --out out/n.png"),
    ),
    "weights": ((WEIGHTS,), (f"measure {CAPTURE} --out out/r --no-mesh --method lambertian-prior:weights={WEIGHTS}",)),
    "checkpoint": (("training/checkpoint.pt",), ("resume training",)),
    "options": (
        ("fixed.txt",),
        ("bench diligent root --out out/runs --methods woodham --objects ball --fixed fixed.txt",),
    ),
}
WRITES = ("runs/*scores.json", "training/*")  # what commands keep in the folders that they read


def originals(place: Path) -> None:
    """Write sound files of every kind."""
    from photonormal.bench import bench
    from photonormal.cli import main
    from tests.scenes import lambertian, ring, sphere, write_diligent

    write_diligent(place / CAPTURE, lambertian(sphere(24), ring(7, 70)))
    bench("diligent", place / "root", place / "runs", methods="woodham", images="all,6", draws=1)
    main(["measure", str(place / CAPTURE), "--out", str(place / "result"), "--method", "woodham", "--no-mesh"])
    tiny(place / "training", resume=False)
    (place / "fixed.txt").write_text("ball: 1-5\n# the others\n1-6\n")


def tiny(out: Path, resume: bool) -> None:
    """A training of one step."""
    from photonormal.train import validate
    from photonormal.train.loop import train
    from photonormal.train.recipes import Recipe
    from tests.train.toy import Toy

    validate.BATCHES = 1
    sizes: dict[str, Any] = {"config": {"width": 8}, "images": (3, 5), "batch": 4, "validate": 9}
    recipe = Recipe(**sizes, steps=1, warmup=1, clip=1.0, ema=0.9)
    train(recipe, out, device="cpu", stream=Toy, precision="float32", resume=resume)


def command() -> int:
    """What the driver's child runs: photonormal's command line, and `resume`, which goes on with the tiny training."""
    from photonormal import cli
    from photonormal.types import InputError

    if sys.argv[1] != "resume":
        return cli.main()
    try:
        tiny(Path(sys.argv[2]), resume=True)
        return 0
    except InputError as error:
        print(f"photonormal: {error}", file=sys.stderr)
        return 2


def faults(driver: Driver, sound: Path, seed: int) -> list[str]:
    """What goes wrong with the file that a seed changes among copies of the sound ones."""
    draw = random.Random(seed)
    patterns, commands = list(KINDS.values())[seed % len(KINDS)]
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary) / "user"
        shutil.copytree(sound, work)
        (work / "out").mkdir()
        file = draw.choice(sorted(p for pattern in patterns for p in work.glob(pattern) if p.is_file()))
        how = changed(file, draw)
        words = draw.choice(commands)
        return [f"{seed} {words}, {file.name} {how}: {f}" for f in driver.faults(work, *words.split(), writes=WRITES)]


def main() -> int:
    with tempfile.TemporaryDirectory() as temporary:
        sound = Path(temporary)
        originals(sound)
        driver = Driver("tests.fuzz.stored_files:command")
        return campaign("changed stored files", 2000, lambda driver, seed: faults(driver, sound, seed), driver)


if __name__ == "__main__":
    sys.exit(main())
