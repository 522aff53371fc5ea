"""Methods that are shown samples: bands of rows and blocks of pixels change nothing, and what was shown is right."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal import InputError
from photonormal.geometry import angle_deg
from photonormal.masked import row_bands
from photonormal.methods import METHODS, configure
from photonormal.methods.contract import Needs, Observations, Solution
from photonormal.methods.engine import on_mask, plan, run, samples, with_lights
from photonormal.methods.engine.device import torch_device
from photonormal.methods.inputs import blocks
from tests.scenes import lambertian, ring, sphere

CPU = torch.device("cpu")
BY_PIXEL = [name for name in METHODS if ".classical." in METHODS[name] and name not in ("rpca", "table", "ward")]
FAST = [name for name in BY_PIXEL if name not in ("consensus", "monotonic")]


@pytest.mark.parametrize("method", FAST)
def test_bands_of_rows_and_blocks_of_pixels_change_nothing(method, monkeypatch):
    capture = lambertian(sphere(24), ring(9))
    whole = run(configure(method), capture, CPU).normals
    monkeypatch.setattr(plan, "LEVELS", 10 * 60)
    monkeypatch.setitem(blocks.BLOCK, "cpu", 10 * 7)
    assert len(row_bands(capture.mask, 60)) > 5
    assert angle_deg(whole.numpy(), run(configure(method), capture, CPU).normals.numpy()).max() < 0.05


@pytest.mark.parametrize("pixels", [1, 30, 100, 10_000])
def test_bands_hold_every_pixel_once(pixels):
    mask = sphere(24).mask
    mask[10:13] = False  # rows without a pixel
    capture = replace(lambertian(sphere(24), ring(9)), mask=mask)
    parts = [samples.grey_levels(capture, within=rows) for rows in row_bands(capture.mask, pixels)]
    assert max(map(len, parts)) <= max(pixels, mask.sum(1).max())
    assert torch.equal(torch.cat(parts), samples.grey_levels(capture))


@dataclass(frozen=True)
class Learning:
    """A matt surface under unknown lights, up to one linear map: normals and lights by descent."""

    steps: int = 60
    needs: ClassVar[Needs] = Needs(images=4, lights=False, finds_lights=True, reads="object", optimises=True)

    def __call__(self, seen: Observations) -> Solution:
        assert seen.L is None and seen.mask is not None and seen.pictures is not None
        assert int(seen.mask.sum()) == len(seen.I)
        assert seen.pictures().shape[0] == seen.I.shape[1]
        U, S, V = torch.linalg.svd(seen.I, full_matrices=False)
        b = (U[:, :3] * S[:3]).clone().requires_grad_()
        L = V[:3].T.clone().requires_grad_()
        optimiser = torch.optim.Adam([b, L], lr=1e-3)
        for _ in range(self.steps):
            optimiser.zero_grad()
            ((b @ L.T - seen.I) ** 2).mean().backward()
            optimiser.step()
        unit = torch.nn.functional.normalize
        return Solution(unit(b, dim=1), lights=unit(L, dim=1), intensities=L.norm(dim=1))


def test_a_method_may_learn_while_it_measures_and_find_the_lights():
    capture = replace(lambertian(sphere(24), ring(9)), lights=None)
    found = run(Learning(), capture, CPU)
    assert found.lights is not None and found.lights.shape == (10, 3) and not found.normals.requires_grad
    assert on_mask(found, capture).mask.any()


def test_the_main_path_takes_what_such_a_method_finds(monkeypatch):
    monkeypatch.setitem(METHODS, "learning", "tests.methods.engine.test_samples:Learning")
    capture = replace(lambertian(sphere(24), ring(9)), lights=None)
    result = pn.measure(capture, "learning", device="cpu")
    assert result.lights is not None and result.albedo is not None and result.surface is not None
    again = pn.measure(capture, "learning", device="cpu", lights="unknown")  # nothing else finds them before
    np.testing.assert_array_equal(again.lights, result.lights)
    with pytest.raises(InputError, match="learning finds the lights itself; leave --refine-lights out"):
        pn.measure(lambertian(sphere(24), ring(9)), "learning", device="cpu", lights="refined")
    assert result.report["method"] == "learning" and result.report["options"] == {"steps": 60}
    lit = with_lights(capture, run(Learning(), capture, CPU))
    shown = np.maximum(np.einsum("hwi,ni->nhw", result.normals.map, lit.known_lights()), 0) * result.albedo[..., 0]
    rest = np.abs(np.stack([lit.images[j][..., 0] for j in range(10)]) - shown)[:, capture.mask]
    assert rest.mean() < 0.1  # normals, lights and albedo explain the photographs, whatever the ambiguity


def test_lights_and_their_number_are_asked_for():
    capture = lambertian(sphere(24), ring(9))
    with pytest.raises(InputError, match=r"10 images came but  ?needs 12 or more lights"):
        run(replace_needs(Needs(images=12)), capture, CPU)
    with pytest.raises(InputError, match="no light directions"):
        run(configure("woodham"), replace(capture, lights=None), CPU)


def replace_needs(needs: Needs):
    return type("Other", (Learning,), {"needs": needs})()


def test_devices_that_do_not_exist_are_refused():
    with pytest.raises(InputError, match=r"no device 'warp'; use auto, cpu or cuda\."):
        torch_device("warp")


def test_the_samples_shown_are_the_photographs():
    capture = lambertian(sphere(24), ring(9))
    images = np.asarray(capture.images)[..., 0]
    assert np.allclose(samples.grey_levels(capture).numpy(), images[:, capture.mask].T, atol=1e-6)
