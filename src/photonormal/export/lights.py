"""Lights as the text of files: `.lp`, a table of directions or intensities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float


def lp(names: Sequence[str], lights: Float[np.ndarray, "n 3"]) -> bytes:
    """An `.lp` file: the count, then `name x y z` a line."""
    lines = [str(len(names))]
    lines += [f"{name} {x:.8f} {y:.8f} {z:.8f}" for name, (x, y, z) in zip(names, lights, strict=True)]
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogateescape")  # names of files are bytes


def table(rows: Float[np.ndarray, "n k"]) -> bytes:
    """A row of numbers a line."""
    return ("\n".join(" ".join(f"{v:.8f}" for v in row) for row in rows) + "\n").encode()
