"""Seconds of the main path: reading against least squares + DCT integration + export, stage by stage.

    python benchmarks/measure.py CAPTURE [CAPTURE ...] [--repeat 5]

Each capture is measured several times in one process and read from its files anew each time; the best of each stage
counts, after one run that is not counted. Peak memory is the whole process's.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import photonormal as pn
from photonormal.export.folder import whole_folder
from photonormal.export.result import write_result


def written(result: pn.Result, folder: Path) -> dict:
    """The report of a result, once it lies in a folder."""
    with whole_folder(folder / "result") as batch:
        return write_result(result, batch)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path, nargs="+")
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    print(
        "| capture | pixels | images | read | least squares | albedo | DCT | export | all but reading | peak memory |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for capture in arguments.capture:
        with tempfile.TemporaryDirectory() as folder:
            reports = [
                written(pn.measure(pn.load(capture), "woodham", device="cpu", integration="simchony"), Path(folder))
                for _ in range(arguments.repeat + 1)
            ][1:]
        best = {stage: min(r["seconds"][stage] for r in reports) for stage in reports[0]["seconds"]}
        rest = sum(s for stage, s in best.items() if stage != "read")
        print(
            f"| {reports[0]['capture']} | {reports[0]['pixels']['mask']} | {reports[0]['lights']} "
            f"| {' | '.join(f'{best[s]:.3f}' for s in ('read', 'solve', 'albedo', 'integrate', 'export'))} "
            f"| {rest:.3f} | {reports[0]['peak_memory_mb']:.0f} MB |"
        )


if __name__ == "__main__":
    main()
