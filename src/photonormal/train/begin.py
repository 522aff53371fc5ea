"""A training that begins with the weights of another one, of a network of the same size or of half the width."""

from __future__ import annotations

from dataclasses import asdict, replace

import torch
from torch import Tensor, nn

from photonormal.methods.learned.network import Model
from photonormal.types import InputError


def begin(net: Model, begun: Model) -> None:
    """Copy the weights of a trained network into a new one; what the new one has besides stays random.

    A network of twice the width begins, where it `widens`, as the same function (after Chen, Goodfellow, Shlens,
    "Net2Net", ICLR 2016): old channels read nothing of the new ones, which are random.
    """
    weights, new = begun.state_dict(), net.state_dict()
    if any(k not in new or new[k].shape != v.shape for k, v in weights.items()):
        if not (net.widens and replace(begun.config, width=2 * begun.config.width) == net.config):
            theirs, ours = asdict(begun.config), asdict(net.config)
            has, needed = (", ".join(f"{k}={c[k]!r}" for k in ours if theirs[k] != ours[k]) for c in (theirs, ours))
            raise InputError(
                f"weights to start from have {has} but the recipe has {needed}; "
                "give weights that this recipe trained, or start without any."
            )
        turned = {f"{name}.weight" for name, m in net.named_modules() if isinstance(m, nn.ConvTranspose2d)}
        weights = {k: widened(v, new[k], outputs=1 if k in turned else 0) for k, v in weights.items()}
    net.load_state_dict(new | weights)


def widened(old: Tensor, fresh: Tensor, outputs: int = 0) -> Tensor:
    """`fresh` random weights with those of half as many channels among them.

    Old channel c becomes 2c, so that it is found again where features are concatenated; the last channels of an axis
    that did not double with the others (a prior) stay the last. `outputs` is the axis of what the layer gives.
    """
    places = [_places(few, many) for few, many in zip(old.shape, fresh.shape, strict=True)]
    wide = fresh.clone()
    if wide.ndim > 1:
        wide.index_fill_(outputs, places[outputs], 0.0)
    wide[torch.meshgrid(*places, indexing="ij")] = old
    return wide


def _places(few: int, many: int) -> Tensor:
    last = 2 * few - many
    return torch.cat([torch.arange(0, 2 * (few - last), 2), torch.arange(many - last, many)])
