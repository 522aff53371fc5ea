"""What the doctor says about a capture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or may be.

    Parameters
    ----------
    kind : reading, saturation, darkness, bits, encoding, coverage, positions, order, frame, repeated, intensities,
        motion, turned, ambient, near, halfway, contrast, mask, or lights (found from the photographs)
    grave : it spoils the normals; otherwise it limits how good they can get
    message : what was found and what to do, one line
    numbers : the figures behind it
    lights : (n, 3) that fit the pictures better, where there are some: directions, or positions in mm of near lamps
    options : of `photonormal.load` and `photonormal measure`, by name, that mend it
    """

    kind: str
    grave: bool
    message: str
    numbers: dict[str, Any] = field(default_factory=dict)
    lights: np.ndarray | None = field(default=None, repr=False)
    options: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"kind": self.kind, "grave": self.grave, "message": self.message, **self.numbers}


def counted(n: int, one: str, several: str) -> str:
    """So many things, in words that follow their number."""
    return f"{n} {one if n == 1 else several}"
