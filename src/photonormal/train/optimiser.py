"""How weights follow their gradients: Adam, or Muon for matrices and Adam for what is left.

K. Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024. The step of a matrix is its
momentum with all singular values made equal, so that no direction waits for the loudest ones.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from photonormal.train.recipes import Recipe

NARROW = 32  # rows or columns of a matrix below which Adam moves it: what a network reads and what it gives


class Optimiser:
    """One or two of torch's optimisers over the weights of a network that learn, with rates that scale together."""

    def __init__(self, net: nn.Module, recipe: Recipe) -> None:
        learning = [p for p in net.parameters() if p.requires_grad]
        self.weights = [p for p in learning if recipe.muon and p.ndim > 1 and min(matrix(p).shape) >= NARROW]
        self.matrices = [nn.Parameter(matrix(p.data)) for p in self.weights]  # the same memory
        moved = {id(p) for p in self.weights}
        rest = [p for p in learning if id(p) not in moved]
        self.parts: list[torch.optim.Optimizer] = [torch.optim.Adam(rest, lr=recipe.lr, fused=rest[0].is_cuda)]
        if self.matrices:
            self.parts.append(torch.optim.Muon(self.matrices, lr=recipe.muon, weight_decay=0.0))
        self.peaks = [part.param_groups[0]["lr"] for part in self.parts]

    def step(self, share: float) -> None:
        """Follow the gradients at this share of the peak rates."""
        for p, m in zip(self.weights, self.matrices, strict=True):
            m.grad = None if p.grad is None else matrix(p.grad)
        for part, peak in zip(self.parts, self.peaks, strict=True):
            part.param_groups[0]["lr"] = share * peak
            part.step()

    def state_dict(self) -> dict[str, Any]:
        """What a resumed training needs."""
        return {str(i): part.state_dict() for i, part in enumerate(self.parts)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`; ValueError where its tensors are not those of the weights."""
        for i, part in enumerate(self.parts):
            part.load_state_dict({"state": state[str(i)]["state"], "param_groups": part.state_dict()["param_groups"]})
            for p, kept in part.state.items():
                if any(torch.is_tensor(v) and v.shape not in (p.shape, ()) for v in kept.values()):
                    raise ValueError("a tensor has not the size of its weights")


def matrix(w: Tensor) -> Tensor:
    """Weights as (outputs, inputs): filters are laid out as `placed` has them, so their memory is shared."""
    return w.permute(0, 2, 3, 1).flatten(1) if w.ndim == 4 else w.flatten(1)
