"""What a training makes small: the error of the normals, or of the lights, as its network says what it learns."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from photonormal.methods.inputs.edges import gradient
from photonormal.methods.learned.lightsnet import told_wrong
from photonormal.methods.learned.network import Model, Network
from photonormal.train.observe import Observed
from photonormal.train.recipes import Recipe

CLOSE = 0.02  # chord, about a degree, below which the loss is quadratic
DOUBT = 0.1  # weight of the loss of expected errors, which moves no normal
EVEN = 8.0  # weight of the normals' error where no edge is, against that of their changes where one is
RENDERED = 0.1  # weight of the images that are rendered back
SYMMETRIC = 0.02  # weight of what maps are off a mirrored map, beside what they are off the samples
BINS = 0.1  # weight of the cross-entropy of a light's bins, beside the error of their means


def error(model: Any, net: Model, seen: Observed, recipe: Recipe, passes: int, fabric: Any) -> Tensor:
    """The loss of a batch; `model` is the network `net` as Fabric calls it."""
    if isinstance(net, Network):
        return of_normals(model, net, seen, recipe, passes, fabric)
    return of_lights(model, seen)


def of_normals(model: Any, net: Network, seen: Observed, recipe: Recipe, passes: int, fabric: Any) -> Tensor:
    """Mean loss over the mask's pixels; its mean over the processes is the mean over all their pixels."""
    found = model(seen.images, seen.lights, seen.prior, passes)  # (passes b, d, h, w)
    truth, mask = seen.normals.repeat(passes, 1, 1, 1), seen.mask.repeat(passes, 1, 1, 1)
    N, learned = found[:, :3], found[:, 3 + net.memory :]
    e = 1 - (N * truth).sum(1)  # (passes b, h, w)
    squared = 2 * e.clamp(min=0)  # |n - n'|^2
    if recipe.loss == "chord":
        e = (squared + CLOSE**2).sqrt() - CLOSE
    if net.teaches == "attention":
        e = attended(e, N * mask, truth, learned[:, 0])
    elif net.teaches == "images":
        e = e + RENDERED * rendered_wrong(learned, seen.images.repeat(passes, 1, 1, 1, 1))
    elif net.teaches == "maps":
        e = e + learned[:, 0] + SYMMETRIC * learned[:, 1]
    elif learned.shape[1]:  # least where the expected error is the mean of the true ones, whatever their size
        true_deg = (2 * torch.asin((squared.detach().sqrt() / 2).clamp(max=1))).rad2deg()
        e = e + DOUBT * (true_deg / learned[:, -1] + learned[:, -1].log())
    pixels = fabric.all_reduce(mask.sum().float(), reduce_op="mean")
    return (e * mask[:, 0]).sum() / pixels


def attended(e: Tensor, N: Tensor, truth: Tensor, P: Tensor) -> Tensor:
    """The error of the normals where attention P (b, h, w) is low, of their changes where it is high (Ju et al. 2020).

    P learns, too, so it goes where that is cheaper: on all but the pixel that its scale keeps at zero.
    """
    changes = (gradient(N) - gradient(truth)).square().sum((0, 2))  # (b, h, w)
    return P * changes + EVEN * (1 - P) * e


def rendered_wrong(guess: Tensor, images: Tensor) -> Tensor:
    """Mean square error (b, h, w) of images rendered back (b, 3 m, h, w), the first m of those that were read."""
    guess = guess.unflatten(1, (-1, 3))  # (b, m, 3, h, w)
    return (guess - images[:, : guess.shape[1]]).square().mean((1, 2))


def of_lights(model: Any, seen: Observed) -> Tensor:
    """Mean loss over the images of all samples: chord of the directions, error of the intensities, and the bins'."""
    wrong = told_wrong(model(seen.images, seen.mask), seen.lights, seen.intensities.log())
    return wrong["angle"] + wrong["intensity"] + BINS * wrong["bins"]
