"""Facts about a network at half the resolution whose correction is carried to the full one."""

from dataclasses import replace

import numpy as np
import torch
from torch.nn import functional as F

import photonormal as pn
from photonormal.geometry import angle_deg, fibonacci_hemisphere
from photonormal.methods.engine.halved import Halved, carried, half_of
from photonormal.methods.engine.windows import Box
from photonormal.types import Capture


def dome(h, w):
    """Normals (3, h, w) of a part of a sphere, with waves, and a mask with a hole and an uneven rim."""
    y, x = torch.meshgrid(torch.linspace(0.6, -0.6, h), torch.linspace(-0.6, 0.6, w), indexing="ij")
    bumps = 0.05 * torch.sin(2.5 * torch.arange(w))
    mask = (x**2 + y**2 < 0.3) & ~((x - 0.1).abs() < 0.07)
    return F.normalize(torch.stack([x + bumps, y, torch.sqrt(1 - x**2 - y**2)]), dim=0) * mask, mask


def halves(N):
    """Directions of the means over two by two pixels."""
    return F.normalize(F.avg_pool2d(N[None], 2)[0], dim=0)


def test_what_the_network_leaves_as_it_is_keeps_every_detail(monkeypatch):
    N, mask = dome(40, 52)
    for rows in (256, 3):  # as a whole, and in bands
        monkeypatch.setattr("photonormal.methods.engine.halved.ROWS", rows)
        found = carried(halves(N), N, mask)
        torch.testing.assert_close(found * mask, N, atol=1e-5, rtol=0)


def test_a_flat_surface_takes_the_networks_slopes():
    mask = dome(20, 24)[1]
    flat = torch.tensor([0.0, 0.0, 1.0])[:, None, None] * mask
    tilt = F.normalize(torch.tensor([0.3, -0.2, 1.0]), dim=0)[:, None, None].expand(3, 10, 12)
    told = torch.full((1, 10, 12), 2.5)
    found = carried(torch.cat([tilt, told]), flat, mask)
    torch.testing.assert_close(found[:3][:, mask], tilt[:, :1, :1].flatten(1).expand(3, int(mask.sum())))
    assert (found[3][mask] - 2.5).abs().max() < 1e-5


def test_halves_are_means_over_the_masks_pixels_alone():
    mask = np.zeros((21, 30), bool)
    mask[3:18, 5:26] = True
    mask[3, 5:9] = False
    images = np.where(mask[None, ..., None], 0.25, 7).astype(np.float32).repeat(4, axis=0)
    images[1] *= np.linspace(0.5, 1.5, 30)[None, :, None]
    capture = Capture(images, mask, fibonacci_hemisphere(4))
    small = half_of(capture, Box.of(capture, 2))
    assert small.mask.shape == (8, 11)
    np.testing.assert_allclose(small.images[0][small.mask], 0.25, rtol=1e-6)
    assert not small.images[0][~small.mask].any()
    x = 5 + 2 * np.arange(10) + 0.5  # between whose columns the means lie
    np.testing.assert_allclose(small.images[1][4, :10, 0], 0.25 * (0.5 + x / 29), rtol=1e-5)
    again = Halved(capture, Box.of(capture, 2))  # where memory does not hold them
    np.testing.assert_array_equal(again.window(1, slice(2, 7), slice(3, 20)), small.images[1][2:7, 3:20])
    np.testing.assert_array_equal(again.window(1, slice(2, 9, 3), slice(3, 20)), small.images[1][2:9:3, 3:20])
    np.testing.assert_array_equal(again[3], small.images[3])


def test_under_lights_that_differ_each_half_takes_those_of_one_of_its_pixels():
    mask = np.zeros((20, 30), bool)
    mask[3:18, 5:26] = True
    capture = Capture(np.ones((4, 20, 30, 1), np.float32), mask, fibonacci_hemisphere(4))
    places = np.argwhere(mask).astype(np.float32)  # (p, 2)
    capture = replace(capture, lights_at=np.repeat(np.pad(places, ((0, 0), (0, 1)))[:, None], 4, axis=1))
    small = half_of(capture, Box.of(capture, 2))
    assert small.lights_at is not None
    seen = np.asarray(small.lights_at[0 : int(small.mask.sum())])[:, 0, :2] - (3, 5)
    np.testing.assert_array_equal(seen // 2, np.argwhere(small.mask))


def test_a_pixel_that_no_light_reached_has_no_normal_and_others_are_better_than_the_classical_ones():
    capture = pn.load("demo")
    images = np.stack([capture.images[j] for j in range(len(capture.image_names))])
    y, x = np.argwhere(capture.mask)[len(np.argwhere(capture.mask)) // 2]
    images[:, y, x] = 0
    capture = replace(capture, images=images)
    truth = capture.truth
    assert truth is not None
    fast, classical = pn.solve(capture, fast=True), pn.solve(capture, "trimmed")
    assert not fast.mask[y, x] and fast.mask.sum() == capture.mask.sum() - 1
    errors = [angle_deg(N.map[fast.mask], truth.map[fast.mask]).mean() for N in (fast, classical)]
    assert errors[0] < errors[1]
