"""The command line: dataclasses become commands, which parse, call and print. The work is elsewhere."""

from __future__ import annotations

import os
import sys

import tyro

from photonormal.cli.measuring import Convert, Integrate, Measure, Methods, Score
from photonormal.cli.rigging import Calibrate, Check, Intensities, Mask
from photonormal.cli.studying import Bench, Figure, Render, Report, Table, Train
from photonormal.options import check
from photonormal.types import InputError

COMMANDS = (
    *(Measure, Score, Integrate, Convert, Methods),
    *(Calibrate, Check, Intensities, Mask),
    *(Bench, Table, Figure, Report, Render, Train),
)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a part failed, 2 wrong input or options, 130 interrupted."""
    try:
        command = tyro.extras.subcommand_cli_from_dict(
            {c.__name__.lower(): c for c in COMMANDS},
            prog="photonormal",
            description="Surface normals, depth and meshes from photographs under known lights.",
            args=arguments,
        )
        check(command, lambda name: f"--{name.replace('_', '-')}")
        code = command()
        sys.stdout.flush()  # a reader that has gone, such as `head`, shows here
        return code
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains again at its end
        return 0
    except InputError as error:
        print(f"photonormal: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
