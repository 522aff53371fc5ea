"""What a training makes small: the error of the normals, or of the lights, as its network says what it learns."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from photonormal.methods.learned.lightsnet import told_wrong
from photonormal.methods.learned.network import Model, Network
from photonormal.train.observe import Observed
from photonormal.train.recipes import Recipe

CLOSE = 0.02  # chord, about a degree, below which the loss is quadratic
DOUBT = 0.1  # weight of the loss of expected errors, which moves no normal
BINS = 0.1  # weight of the cross-entropy of a light's bins, beside the error of their means


def error(model: Any, net: Model, seen: Observed, recipe: Recipe, passes: int, fabric: Any) -> Tensor:
    """The loss of a batch; `model` is the network `net` as Fabric calls it."""
    if isinstance(net, Network):
        return of_normals(model, seen, recipe, net.memory, passes, fabric)
    return of_lights(model, seen)


def of_normals(model: Any, seen: Observed, recipe: Recipe, memory: int, passes: int, fabric: Any) -> Tensor:
    """Mean loss over the mask's pixels; its mean over the processes is the mean over all their pixels."""
    found = model(seen.images, seen.lights, seen.prior, passes)  # (passes b, d, h, w)
    truth, mask = seen.normals.repeat(passes, 1, 1, 1), seen.mask.repeat(passes, 1, 1, 1)
    e = 1 - (found[:, :3] * truth).sum(1)  # (passes b, h, w)
    squared = 2 * e.clamp(min=0)  # |n - n'|^2
    if recipe.loss == "chord":
        e = (squared + CLOSE**2).sqrt() - CLOSE
    if found.shape[1] > 3 + memory:  # least where the expected error is the mean of the true ones, whatever their size
        true_deg = (2 * torch.asin((squared.detach().sqrt() / 2).clamp(max=1))).rad2deg()
        e = e + DOUBT * (true_deg / found[:, -1] + found[:, -1].log())
    pixels = fabric.all_reduce(mask.sum().float(), reduce_op="mean")
    return (e * mask[:, 0]).sum() / pixels


def of_lights(model: Any, seen: Observed) -> Tensor:
    """Mean loss over the images of all samples: chord of the directions, error of the intensities, and the bins'."""
    wrong = told_wrong(model(seen.images, seen.mask), seen.lights, seen.intensities.log())
    return wrong["angle"] + wrong["intensity"] + BINS * wrong["bins"]
