"""What the lights' network gives: of a capture, and of whole objects that a training shows."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.lighting import under
from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.lightsnet import SIDE, BinnedLights, LightsNet
from photonormal.methods.learned.network import placed
from photonormal.methods.learned.processor import inner_precision
from photonormal.methods.uncalibrated.limits import refuse_narrow
from photonormal.methods.uncalibrated.reduced import reduced
from photonormal.shading import normalised
from photonormal.types import Capture


class Guess(NamedTuple):
    """Lights of n images, from the photographs alone."""

    lights: Float[Tensor, "n 3"]  # unit
    intensities: Float[Tensor, " n"]  # of geometric mean 1
    told_deg: Float[Tensor, " n"]  # how broad the network's answer is

    def shown_by(self, capture: Capture) -> Capture:
        """The capture under these lights, divided by their intensities; InputError where no normals could be found."""
        refuse_narrow(self.lights, capture.name)
        return under(capture, self.lights.double().numpy(), self.intensities.double().numpy())


def guess(net: LightsNet, capture: Capture, device: torch.device) -> Guess:
    """The mean over the eight symmetries of a square; the capture's own lights aren't looked at."""
    images, inside = reduced(capture, SIDE)
    images, mask = images[None].to(device), inside[None, None].to(device)
    net = placed(net, device).eval()
    with torch.inference_mode():
        looks = [looked(net, turned(images, case), turned(mask, case)) for case in range(8)]
        L = torch.stack([turned_back(t.directions[0], case) for case, t in enumerate(looks)]).mean(0)
        e = torch.stack([t.log_intensities[0] for t in looks]).mean(0).exp()
        doubt = torch.stack([t.told_deg[0] for t in looks]).mean(0)
    return Guess(*(v.cpu().float() for v in (normalised(L), e, doubt)))


def looked(net: LightsNet, images: Float[Tensor, "b n c s s"], mask: Bool[Tensor, "b 1 s s"]) -> BinnedLights:
    """What the network gives of whole objects in linear images, in one look."""
    x = scaled(net.scaling, images, mask, moment(net.scaling, images, mask), images.shape[1])
    with inner_precision(images.device):
        return net(x, mask)


def turned(maps: Tensor, case: int) -> Tensor:
    """One of the eight symmetries of a square, of pictures: a mirror image from 4 on, then quarter turns."""
    return torch.rot90(maps.flip(-1) if case >= 4 else maps, case % 4, (-2, -1))


def turned_back(L: Float[Tensor, "n 3"], case: int) -> Float[Tensor, "n 3"]:
    """Lights of pictures that were `turned`, as lights of the pictures before."""
    for _ in range(case % 4):  # clockwise: (x, y) -> (y, -x)
        L = torch.stack([L[:, 1], -L[:, 0], L[:, 2]], dim=1)
    return L * L.new_tensor([-1.0, 1.0, 1.0]) if case >= 4 else L
