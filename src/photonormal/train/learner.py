"""The network that learns, with all that goes with it: its optimiser, the mean of its weights, those it began with."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from photonormal.methods.learned.network import Model, placed
from photonormal.methods.learned.weights import build
from photonormal.train import checkpoint
from photonormal.train.averages import averaged, follow, moved
from photonormal.train.begin import begin
from photonormal.train.checkpoint import TrainingState
from photonormal.train.objective import error
from photonormal.train.observe import observe
from photonormal.train.optimiser import Optimiser
from photonormal.train.recipes import Recipe
from photonormal.types import InputError


class Learner:
    """The network of a recipe on the devices of a Fabric.

    Parameters
    ----------
    begun : network that it begins with; None: random weights
    state : content of the checkpoint in `out` that it goes on from; None: none

    Raises
    ------
    InputError
        If the checkpoint or `begun` holds another network.
    """

    def __init__(self, recipe: Recipe, fabric: Any, begun: Model | None, state: TrainingState | None, out: Path):
        torch.manual_seed(recipe.seed)
        net: Model = placed(build(recipe.network, recipe.built), "cpu")
        if begun is not None:
            begin(net, begun)
        self.origin = _copied(net) if recipe.moved < 1 else {}
        for key, p in net.named_parameters():
            p.requires_grad_(key.startswith(recipe.learn))
        mean = _copied(net) if recipe.ema else {}
        if state:
            checkpoint.fits(out, state["network"], net.state_dict())
            checkpoint.fits(out, state["mean"], mean)
            net.load_state_dict(state["network"])
            mean = state["mean"]
        self.recipe, self.fabric, self.net = recipe, fabric, net
        self.model = fabric.setup_module(net)
        self.optimiser = Optimiser(net, recipe)
        if state:
            try:
                self.optimiser.load_state_dict(state["optimiser"])
            except (ValueError, KeyError, TypeError, AttributeError, RuntimeError):
                raise InputError(f"checkpoint in {out} holds no state of its optimiser; start again.") from None
        self.mean = {k: v.to(fabric.device) for k, v in mean.items()}

    def step(self, batches: Iterator, step: int, share: float) -> Tensor:
        """Learn from the batches of one step, at a share of the peak rate; returns their mean loss."""
        recipe, losses = self.recipe, []
        self.net.zero_grad()
        for part in range(step * recipe.accumulate, (step + 1) * recipe.accumulate):
            seen = observe(next(batches), recipe, self.net.scaling, part, self.fabric.global_rank)
            passes = 1 if step < recipe.once else recipe.passes
            loss = error(self.model, self.net, seen, recipe, passes, self.fabric)
            self.fabric.backward(loss / recipe.accumulate)
            losses.append(loss.detach())
        finite = True
        if recipe.clip:
            finite = bool(torch.nn.utils.clip_grad_norm_(self.net.parameters(), recipe.clip).isfinite())
        if finite:  # else this batch teaches nothing
            self.optimiser.step(share)
        if recipe.ema:
            follow(self.mean, self.net, min(recipe.ema, (1 + step) / (10 + step)))
        return torch.stack(losses).mean()

    def shown(self) -> Model:
        """The network that is validated and written."""
        return moved(averaged(self.net, self.mean), self.origin, self.recipe.moved)

    def state(self) -> dict[str, Any]:
        """What a checkpoint keeps of it."""
        return {"network": self.net.state_dict(), "optimiser": self.optimiser.state_dict(), "mean": self.mean}


def _copied(net: Model) -> dict[str, Tensor]:
    return {k: v.clone() for k, v in net.state_dict().items()}
