"""How options are shown in the help: what to give, and no default where there is none."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import tyro

from photonormal.options import Positive
from photonormal.types import printable

File = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
Folder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")]
Millimetres = Annotated[Positive | None, tyro.conf.arg(metavar="MM", help_behavior_hint="")]
Pixels = Annotated[Positive | None, tyro.conf.arg(metavar="PX", help_behavior_hint="")]


def tell(line: str) -> None:
    """Print what was found out beside the results."""
    print(f"photonormal: {printable(line)}", file=sys.stderr)
