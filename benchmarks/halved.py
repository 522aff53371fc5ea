"""What `--fast` costs in accuracy, on rendered objects of materials that no network saw in training.

    python benchmarks/halved.py [--scenes 40] [--lights 48]

Mean angular errors in degrees: of the full resolution, of `--fast` as it ships, and of the choices that it was made
with: the network's prior at half the resolution, and by how many degrees it bends normals where a classical method's
detail counts for 1 / e.
"""

from __future__ import annotations

import argparse
from unittest.mock import patch

import numpy as np
import torch
from classical import print_row
from expected import scenes
from learned import mean_deg

from photonormal.methods import configure
from photonormal.methods.engine import halved

CPU = torch.device("cpu")
NONE, ALL = 1e-6, 1e9  # of the detail
CHOICES = [(prior, bent_deg) for prior in ("l1", "trimmed") for bent_deg in (NONE, 3.0, 6.0, 12.0, ALL)]
FULL, FAST = configure("normalnet"), configure("normalnet", fast=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=40)
    parser.add_argument("--lights", type=int, default=48)
    args = parser.parse_args()
    errors = []
    for capture in scenes(args.scenes, 4242, lights=(args.lights, args.lights), scenes=1):
        row = [mean_deg(FULL, capture, CPU), mean_deg(FAST, capture, CPU)]
        for prior, bent_deg in CHOICES:
            with patch.multiple(halved, PRIOR=prior, BENT_DEG=bent_deg):
                row.append(mean_deg(FAST, capture, CPU))
        errors.append(row)
    means, spread = np.mean(errors, axis=0), np.std(np.subtract(errors, np.array(errors)[:, 1:2]), axis=0)
    print_row("normalnet", "prior", "degrees bent", "mean error", "standard error of what it is above `--fast`")
    print_row(*["---"] * 5)
    named = {NONE: "no detail", ALL: "all of the detail"}
    rows = [("full", "", ""), ("`--fast`", "", "")]
    rows += [("", prior, named.get(bent_deg, f"{bent_deg:g}")) for prior, bent_deg in CHOICES]
    for row, mean, s in zip(rows, means, spread, strict=True):
        print_row(*row, f"{mean:.3f}", f"{s / np.sqrt(len(errors)):.3f}")


if __name__ == "__main__":
    main()
