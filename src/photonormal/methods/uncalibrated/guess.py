"""What the lights' network tells of a capture."""

from __future__ import annotations

import torch

from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.lightsnet import SIDE, Lights, LightsNet
from photonormal.methods.learned.network import placed
from photonormal.methods.learned.processor import inner_precision
from photonormal.methods.uncalibrated.reduced import reduced
from photonormal.types import Capture


def guess(net: LightsNet, capture: Capture, device: torch.device) -> Lights:
    """The lights (1, n, ...) of a capture's images, on the processor; the capture's own lights aren't looked at."""
    images, inside = reduced(capture, SIDE)
    images, mask = images[None].to(device), inside[None, None].to(device)
    net = placed(net, device).eval()
    with torch.inference_mode(), inner_precision(device):
        x = scaled(net.scaling, images, mask, moment(net.scaling, images, mask), images.shape[1])
        told = net(x, mask)
    return Lights(*(v.cpu() for v in told))
