"""Rendered scenes obey the image-formation equation."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from photonormal.methods.classical.woodham import Woodham
from photonormal.shading import LUMA
from photonormal.synth.params import rng
from photonormal.synth.pathtraced.compare import plain_coats
from photonormal.synth.recipes import _NOISELESS, _PERFECT, recipe
from photonormal.synth.scene import draw_scenes, frame, shaded
from photonormal.synth.stream import render_block
from photonormal.synth.trace import NOWHERE, Geometry, visible_surface

CPU = torch.device("cpu")
SIZE = 64


def rendered(changes: dict, seed: int = 0, n: int = 8, name: str = "train"):
    """Images (b, n, 3, p) of three whole scenes, and their geometry and lights."""
    made = recipe(name, size=SIZE, crop=SIZE, crops=1, zoom=0.0, **changes)
    scenes = draw_scenes(made, rng(seed), 3, n, None)
    view, start = frame(scenes, SIZE)
    geometry = visible_surface(scenes.solids, view, start)
    pixels = torch.arange(SIZE * SIZE).expand(3, -1)
    return shaded(scenes, geometry, pixels, made, None, 0), geometry, scenes.lights


def test_lambertian_images_give_back_the_normals_by_least_squares():
    batch = render_block(recipe("lambert", size=SIZE, crop=SIZE, scenes=3, lights=(12, 12), narrow=1.0), 0, 0, CPU, 3)
    for images, lights, normals, mask in zip(batch.images, batch.lights, batch.normals, batch.mask, strict=True):
        n, l = normals[:, mask[0]].T.double(), lights.double()  # (p, 3), (12, 3)
        reached = (n @ l.T > 0.02).all(1)
        assert reached.sum() > 300
        I = torch.einsum("nchw,c->hwn", images, torch.tensor(LUMA))[mask[0]].double()
        found = Woodham().normals(I, l)[reached]
        error = torch.rad2deg(torch.linalg.cross(found, n[reached]).norm(dim=1))
        assert error.max() < 1e-2


def test_lambertian_images_are_albedo_times_cosine():
    changes = {"materials": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "shadows": False, "bounce": 0.0, "ambient": 0.0}
    I, g, L = rendered({**changes, "varying": 0.0})
    cos = torch.einsum("bip,bni->bnp", g.normals.flatten(2), L).clamp(min=0)
    for i in range(3):
        ratio = (I[i] / cos[i, :, None].clamp(min=1e-6)).movedim(1, -1)[cos[i] > 0.1]  # (., 3)
        if ratio.std(0).max() < 1e-4:  # without a texture the albedo is one colour
            assert ((ratio > 0) & (ratio < 1)).all()
            return
    pytest.fail("all three scenes are textured")


@pytest.mark.parametrize("seed", [0, 1])
def test_shadows_only_take_light_and_the_bounce_only_adds_some(seed):
    shapes = (0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0)
    base = {"shapes": shapes, "ambient": 0.0}
    plain, _, _ = rendered({**base, "shadows": False, "bounce": 0.0}, seed)
    shadowed, _, _ = rendered({**base, "bounce": 0.0}, seed)
    bounced, _, _ = rendered({**base, "bounce": 1.0}, seed)
    assert (plain >= 0).all() and plain.isfinite().all()
    assert (shadowed <= plain + 1e-6).all() and (shadowed < plain - 1e-3).any()
    assert (bounced >= shadowed - 1e-6).all() and (bounced > shadowed + 1e-3).any()


def test_about_a_tenth_of_what_faces_its_light_is_in_cast_shadow():
    changes = {**_NOISELESS, **_PERFECT, "bounce": 0.0, "materials": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}
    shadowed, facing = (
        (render_block(recipe("train", lights=(6, 6), shadows=on, **changes), 1, 0, CPU, 256).images > 0).sum()
        for on in (True, False)
    )
    assert 0.08 < 1 - shadowed / facing < 0.15


def test_nothing_is_brighter_than_the_bound_at_mirror_geometry():
    from photonormal.synth.materials import BRIGHTEST

    I, _, _ = rendered({"materials": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), "bounce": 0.0, "ambient": 0.0})
    assert I.max() <= BRIGHTEST + 1e-3


@pytest.mark.parametrize("bounce", [0.0, 1.0])
def test_a_lamp_far_away_is_a_direction(bounce):
    near, _, _ = rendered({"distance": 1e4, "shadows": False, "bounce": bounce})
    far, _, _ = rendered({"shadows": False, "bounce": bounce})
    assert torch.allclose(near, far, rtol=1e-2, atol=2e-3)


def test_a_lamp_nearby_lights_what_is_near_it_more():
    changes = {"materials": (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), "shadows": False, "bounce": 0.0, "varying": 0.0}
    near, g, L = rendered({**changes, "distance": 3.0})
    far, _, _ = rendered(changes)
    ratio = (near / far.clamp(min=1e-6))[:, :, 1]  # (b, n, p)
    x = torch.linspace(-1, 1, SIZE).repeat(SIZE)
    lit = (far[:, :, 1] > 0.1) & g.mask.flatten(1)[:, None]
    towards = (x * L[..., :1] > 0.2) & lit
    away = (x * L[..., :1] < -0.2) & lit
    assert ratio[towards].mean() > 1.1 * ratio[away].mean()


def test_what_is_small_reflects_a_lamp_nearby_as_a_light_from_its_own_direction():
    """Two small metal roofs that face each other: what the right one sends to the left one."""
    c = torch.arange(SIZE).expand(SIZE, SIZE) + 0.0
    r = c.T
    left, right = (((c - at).abs() < 4) & ((r - 32).abs() < 4) for at in (20, 44))
    mask = left | right
    z = (torch.where(left, 20 - c, c - 44) * mask)[None]
    n = torch.stack([torch.where(left, 1.0, -1.0), torch.zeros(SIZE, SIZE), torch.ones(SIZE, SIZE)]) * 0.5**0.5 * mask
    nothing = torch.full((1, 2, SIZE, SIZE), NOWHERE)
    roofs = Geometry(z, n[None], mask[None], torch.zeros(1, 3, SIZE, SIZE), nothing)
    made = recipe("train", materials=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), varying=0.0, shadows=False, ambient=0.0)
    scenes = draw_scenes(made, rng(0), 1, 1, None)
    scenes.coats.palette[:] = torch.tensor([0.9, 0.7, 0.4, 1, 0.5, 0.5, 0, 0, 0, 0, 0])  # rough metal

    def added(distance: float | None, light: torch.Tensor) -> torch.Tensor:
        """Light of the bounce (3,) on the left roof."""
        both, direct = (
            shaded(
                replace(scenes, lights=light.view(1, 1, 3), bounce=torch.tensor([on])), roofs,
                torch.arange(SIZE**2)[None], recipe(made, distance=distance), None, 0,
            )
            for on in (True, False)
        )  # fmt: skip
        return (both - direct)[0, 0, :, left.flatten()].mean(1)

    from_middle = torch.tensor([-0.6, 0.0, 0.8])  # the lamp is 36 pixels away
    to_lamp = 36 * from_middle + torch.tensor([SIZE / 2 - 44 - 0.5, 0, 0])  # from the right roof
    far = added(None, to_lamp / to_lamp.norm()) * (36 / to_lamp.norm()) ** 2
    assert torch.allclose(added(36 / (SIZE / 2), from_middle), far, rtol=0.2)
    assert (added(None, from_middle) > 2 * far).all()  # so that the direction counts


def test_light_in_a_matt_bowl_comes_back_again_and_again():
    """60 degrees of a sphere send a quarter of what arrives to themselves, evenly."""
    t = torch.arange(SIZE) + 0.5 - SIZE / 2
    x, y = t.expand(SIZE, SIZE), -t[:, None].expand(SIZE, SIZE)
    rim = 0.47 * SIZE
    R = rim / math.sin(math.radians(60))
    inside = x**2 + y**2 < rim**2
    z = R / 2 - torch.where(inside, R**2 - x**2 - y**2, R**2 / 4).sqrt()
    n = torch.where(inside, torch.stack([-x, -y, R / 2 - z]) / R, torch.tensor([0.0, 0, 1]).view(3, 1, 1))
    nothing = torch.full((1, 2, SIZE, SIZE), NOWHERE)
    bowl = Geometry(z[None], n[None], (z < 1)[None], torch.zeros(1, 3, SIZE, SIZE), nothing)
    made = recipe("train", materials=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0), varying=0.0, shadows=False, ambient=0.0)
    scenes = draw_scenes(made, rng(0), 1, 1, None)
    scenes = replace(
        scenes, lights=torch.tensor([[[0.0, 0, 1]]]), coats=plain_coats(scenes.coats, np.array([0.9, 0.6, 0.3]))
    )
    pixels = torch.arange(SIZE**2)[None]

    def light(bounces: int) -> torch.Tensor:
        """Mean over the bowl of each channel, with that many bounces."""
        scene = replace(scenes, bounce=torch.tensor([bounces > 0]))
        I = shaded(scene, bowl, pixels, recipe(made, bounces=max(1, bounces)), None, 0)
        return I[0, 0, :, inside.flatten()].mean(1)

    once, thrice, direct = light(1), light(3), light(0)
    a = torch.tensor([0.9, 0.6, 0.3]) / 4
    assert torch.allclose((thrice - direct) / (once - direct), 1 + a + a**2, rtol=0.05)


def test_hollow_metal_is_metal_and_its_walls_light_each_other():
    made = recipe("hollow-metal")
    scenes = draw_scenes(made, rng(1), 20, 4, None)
    assert scenes.bounce.all() and (scenes.coats.family == 0).all()
    assert (scenes.coats.palette[..., 3] >= 0.3).all()  # metallic
    assert (draw_scenes(recipe("train"), rng(1), 20, 4, None).coats.palette[..., 3] == 0).any()
