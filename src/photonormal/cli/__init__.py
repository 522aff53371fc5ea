"""The command line: dataclasses become commands, which parse, call and print. The work is elsewhere."""

from __future__ import annotations

import contextlib
import io
import sys
import warnings
from collections.abc import Callable
from typing import Any

import tyro

from photonormal import __version__
from photonormal.cli.batching import Batch, Watch
from photonormal.cli.faults import fault, one_line
from photonormal.cli.kinds import say_no_more
from photonormal.cli.mapping import Convert, Integrate, Score
from photonormal.cli.measuring import Measure, Methods
from photonormal.cli.rigging import Calibrate, Check, Intensities, Lights, Mask
from photonormal.cli.studying import Bench, Figure, Render, Report, Table, Train
from photonormal.cli.viewing import Export, View
from photonormal.options import check_fields
from photonormal.types import InputError

COMMANDS = (
    *(Measure, Score, Integrate, Convert, Methods),
    *(Batch, Watch),
    *(View, Export),
    *(Calibrate, Check, Intensities, Mask, Lights),
    *(Bench, Table, Figure, Report, Render, Train),
)


def main(arguments: list[str] | None = None, interrupted: Callable[[], bool] = lambda: False) -> int:
    """Run one command; returns the exit code.

    0: done. 1: a part failed, or photonormal has a fault. 2: wrong input or options. 130: interrupted.

    Parameters
    ----------
    arguments : words of the command line, in place of the process's own
    interrupted : says that a signal has come, which some libraries turn into errors of their own
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # names of files are bytes
    if arguments is None and not sys.warnoptions:
        warnings.simplefilter("ignore")  # what libraries warn of says nothing to a user; what matters ends in our words
    try:
        if (sys.argv[1:] if arguments is None else arguments) == ["--version"]:
            print(f"photonormal {__version__}")
            return 0
        code = parsed(arguments)()
        sys.stdout.flush()  # a reader that has gone, such as `head`, shows here
        return code
    except BrokenPipeError:
        say_no_more()
        return 0
    except InputError as error:
        print(f"photonormal: {error}", file=sys.stderr)
        return 2
    except MemoryError:
        print("photonormal: memory is not enough for this; give fewer or smaller photographs.", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        if interrupted():
            return 130
        print(f"photonormal: {fault(error, arguments)}", file=sys.stderr)
        return 1


def parsed(arguments: list[str] | None) -> Any:
    """The command that the words of the command line ask for; InputError where they can't be understood."""
    told = io.StringIO()
    commands = {c.__name__.lower(): c for c in COMMANDS}
    try:
        with contextlib.redirect_stderr(told):
            command = tyro.extras.subcommand_cli_from_dict(
                commands,
                prog="photonormal",
                description="Surface normals, depth and meshes from photographs under known lights. The usual "
                "order is calibrate, check, measure, view. --version prints the version.",
                args=arguments,
            )
    except SystemExit as ended:
        if not ended.code:  # --help
            raise
        words = sys.argv[1:] if arguments is None else arguments
        command = words[0] if words and words[0] in commands else ""
        raise InputError(one_line(told.getvalue(), command)) from None
    check_fields(command, lambda name: f"--{name.replace('_', '-')}")
    return command
