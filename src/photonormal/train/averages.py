"""Means of weights: over the steps of a training, and of a network with the one that it began with."""

from __future__ import annotations

from torch import Tensor

from photonormal.methods.learned.network import M, Model, placed


def follow(mean: dict[str, Tensor], net: Model, decay: float) -> None:
    """mean <- decay mean + (1 - decay) weights, for every tensor of the network."""
    weights = net.state_dict()
    for k, v in mean.items():
        v.lerp_(weights[k], 1 - decay)


def averaged(net: M, mean: dict[str, Tensor]) -> M:
    """A copy of the network with the running mean of its weights, or itself where there is none."""
    if not mean:
        return net
    copy = type(net)(net.config)
    copy.load_state_dict(mean)
    return placed(copy, next(iter(mean.values())).device)


def moved(net: M, origin: dict[str, Tensor], share: float) -> M:
    """A copy of the network a share of the way from other weights to its own, or itself for the whole way.

    Wortsman et al., "Robust fine-tuning of zero-shot models" (CVPR 2022): what the former weights knew stays.
    """
    if share == 1:
        return net
    weights = net.state_dict()
    return averaged(net, {k: v.to(weights[k]).lerp(weights[k], share) for k, v in origin.items()})
