"""What is known of every pixel of a box, of which windows read and write parts: in memory, or on disk beside it."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.files.rows import Rows
from photonormal.methods.engine import plan
from photonormal.methods.engine.windows import Span


class Maps:
    """`d` maps (h, w) of a box, zeros at first: ``maps[rows, columns]`` is a part (d, i, j), which may be set.

    On a processor a large box has them in a scratch file (`plan.lies_aside`), which ends with this.
    """

    def __init__(self, d: int, box: tuple[int, ...], device: torch.device) -> None:
        h, w = box
        self._rows = Rows((h, d, w), np.float32) if plan.lies_aside(box, device) else None
        self._held = torch.zeros((d, 0, w) if self._rows else (d, h, w), device=device)

    def __getitem__(self, seen: Span) -> Float[Tensor, "d i j"]:
        rows, columns = seen
        if self._rows is None:
            return self._held[:, rows, columns]
        return torch.from_numpy(self._rows[rows]).transpose(0, 1)[..., columns]

    def __setitem__(self, seen: Span, values: Float[Tensor, "d i j"]) -> None:
        rows, columns = seen
        if self._rows is None:
            self._held[:, rows, columns] = values
            return
        part = self._rows[rows]
        part[..., columns] = values.transpose(0, 1).numpy()
        self._rows[rows] = part
