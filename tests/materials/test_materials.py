"""Spheres of known roughness, and what must not change it."""

import json
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import torch

import photonormal as pn
from photonormal.cli import main
from photonormal.files.decode import decode
from photonormal.files.rows import Rows
from photonormal.geometry import fibonacci_hemisphere
from photonormal.masked import row_bands
from photonormal.materials import maps, materials_of
from photonormal.materials.lobes import samples
from photonormal.methods import METHODS
from photonormal.methods.contract import Needs, Solution
from photonormal.types import Camera, Capture, InputError, Lamps, Normals
from tests.scenes import lambertian, sphere, write_diligent

LIGHTS = fibonacci_hemisphere(120)
LIGHTS = LIGHTS[LIGHTS[:, 2] > 0.35]


def shiny(roughness, albedo=(0.4, 0.3, 0.1), F0=(0.05, 0.05, 0.05), size=40):
    """A sphere with a matt part and a GGX highlight; a white surface would show 1, and none is saturated."""
    truth = sphere(size)
    N = torch.from_numpy(truth.map[truth.mask])
    L = torch.from_numpy(LIGHTS.astype(np.float32))
    none = torch.zeros(len(N), len(L), 3, dtype=torch.bool)
    s = samples(torch.zeros(len(N), len(L), 3), N, L, none)
    lobe = s.lobe(torch.tensor([[roughness]])) * (s.cos_l > 0)
    shown = s.cos_l.clamp(min=0)[..., None] * torch.tensor(albedo) + lobe[..., None] * torch.tensor(F0)  # (p, n, 3)
    images = np.zeros((len(L), *truth.mask.shape, 3), np.float32)
    images[:, truth.mask] = shown.numpy().swapaxes(0, 1)
    return Capture(images, truth.mask, LIGHTS, truth=truth, name="ball")


def middle(map, size=40):
    """Where normals are at most 30 degrees from the view, which lights all around can show highlights on."""
    y, x = np.mgrid[1 : -1 : 1j * size, -1 : 1 : 1j * size]
    return map[np.hypot(x, y) < 0.45]


def test_maps_on_disk_are_those_in_memory(monkeypatch):
    capture = shiny(0.3)
    held = materials_of(capture, capture.truth)
    monkeypatch.setattr(maps.plan, "lies_aside", lambda *_: True)
    aside = materials_of(capture, capture.truth)
    for name in ("albedo", "specular", "roughness", "metalness"):
        assert isinstance(getattr(aside, name), Rows)
        np.testing.assert_array_equal(getattr(aside, name), getattr(held, name))
    np.testing.assert_array_equal(aside.roughness[capture.mask], held.roughness[capture.mask])


@pytest.mark.parametrize("roughness", [0.2, 0.35, 0.5, 0.7])
def test_the_roughness_of_a_sphere_is_found_and_its_albedo_has_no_highlight(roughness):
    capture = shiny(roughness)
    found = materials_of(capture, capture.truth)
    told = middle(found.roughness)
    assert np.isfinite(told).mean() > 0.7  # sharp highlights fit between the lights
    assert np.nanmax(np.abs(told - roughness)) < 0.03
    seen = np.isfinite(found.roughness)
    assert np.abs(np.median(found.albedo[seen], axis=0) - [0.4, 0.3, 0.1]).max() < 0.01
    assert np.abs(np.median(found.specular[seen], axis=0) - 0.05).max() < 0.005
    assert not (found.metalness == 1).any()


def test_a_broad_highlight_that_a_pixel_shows_alone_is_not_believed():
    glossy, matt = shiny(0.6), shiny(0.6, F0=(0, 0, 0))
    images = matt.images.copy()
    images[:, 20, 20] = glossy.images[:, 20, 20]
    assert np.isfinite(materials_of(glossy, glossy.truth).roughness[20, 20])
    found = materials_of(replace(matt, images=images), matt.truth)
    assert not np.isfinite(found.roughness).any() and not found.specular.any()


def test_a_sphere_without_matt_part_is_a_metal_and_shows_its_colour():
    capture = shiny(0.4, albedo=(0, 0, 0), F0=(0.9, 0.7, 0.3))
    found = materials_of(capture, capture.truth)
    told = middle(found.metalness)
    assert (told == 1).mean() > 0.9 and not (told == 0).any()
    assert np.abs(np.median(middle(found.specular), axis=0) / [0.9, 0.7, 0.3] - 1).max() < 0.05


def test_of_a_matt_sphere_nothing_is_told_but_its_albedo():
    capture = lambertian(sphere(40), LIGHTS)
    found = materials_of(capture, capture.truth)
    assert np.isnan(found.roughness).all() and np.isnan(found.metalness).all() and not found.specular.any()
    assert np.abs(found.albedo[capture.mask] - 0.7).max() < 1e-3


def same(a, b, unit=1.0):
    """Equal but for the last bits, which may turn the choice in a pixel that two values fit as well."""
    assert np.array_equal(np.isnan(a.roughness), np.isnan(b.roughness))
    assert (np.abs(a.roughness - b.roughness)[np.isfinite(a.roughness)] < 1e-2).mean() > 0.99
    assert np.array_equal(a.metalness, b.metalness, equal_nan=True)
    assert np.quantile(np.abs(unit * a.albedo - b.albedo), 0.99) < 1e-4 * unit


def test_exposure_changes_the_unit_alone_and_the_order_of_images_nothing():
    capture = shiny(0.35)
    found = materials_of(capture, capture.truth)
    for exposure in (1e-5, 16, 2**16, 1e8):
        brighter = replace(capture, images=np.float32(exposure) * np.asarray(capture.images))
        same(found, materials_of(brighter, capture.truth), exposure)
    order = np.random.default_rng(0).permutation(len(LIGHTS))
    same(found, materials_of(replace(capture, images=capture.images[order], lights=LIGHTS[order]), capture.truth))


def test_some_rows_at_a_time_give_what_all_at_once_give(monkeypatch):
    capture = shiny(0.35)
    found = materials_of(capture, capture.truth)
    monkeypatch.setattr(maps, "row_bands", lambda mask, pixels: row_bands(mask, 100))
    monkeypatch.setattr(maps, "PIXELS", 64)
    same(found, materials_of(capture, capture.truth))


def test_lights_that_each_pixel_sees_and_pixels_without_normals_change_nothing_elsewhere():
    capture = shiny(0.35)
    found = materials_of(capture, capture.truth)
    seen = replace(capture, lights_at=np.broadcast_to(np.float32(LIGHTS), (capture.mask.sum(), *LIGHTS.shape)))
    same(found, materials_of(seen, capture.truth))
    part = capture.mask.copy()
    part[:, :15] = False
    some = materials_of(seen, Normals(capture.truth.map * part[..., None], part))
    assert np.isnan(some.roughness[~part]).all() and not some.albedo[~part].any()
    assert np.abs(some.albedo - found.albedo)[:, 18:].max() < 1e-4


def test_samples_in_shadow_and_saturated_ones_do_not_count():
    capture = shiny(0.35)
    images = np.array(capture.images)
    images[::7, :, :20] = 0
    shaded = materials_of(replace(capture, images=images), capture.truth)
    assert np.nanmedian(np.abs(middle(shaded.roughness) - 0.35)) < 0.03
    white = np.quantile(images[:, capture.mask], 0.995)
    clipped = replace(capture, images=images.clip(max=white), saturation=np.full((len(LIGHTS), 3), white))
    assert np.nanmedian(np.abs(middle(materials_of(clipped, capture.truth).roughness) - 0.35)) < 0.03


def test_a_pixel_that_is_black_under_all_lights_is_a_matt_black_one():
    capture = shiny(0.35)
    images = np.array(capture.images)
    images[:, 18:22, 18:22] = 0
    found = materials_of(replace(capture, images=images), capture.truth)
    assert not found.albedo[19:21, 19:21].any() and not found.specular[19:21, 19:21].any()
    assert np.isnan(found.roughness[19:21, 19:21]).all()


def test_a_highlight_whose_middle_is_saturated_is_one():
    capture = shiny(0.25)
    white = 0.6  # the matt part shows at most 0.4
    images = np.asarray(capture.images)
    assert (images[:, capture.mask] > white).any((0, 2)).mean() > 0.3
    clipped = replace(capture, images=images.clip(max=white), saturation=np.full((len(LIGHTS), 3), white))
    whole, told = (middle(materials_of(seen, capture.truth).roughness) for seen in (capture, clipped))
    assert np.isfinite(told).sum() > 0.8 * np.isfinite(whole).sum()
    assert np.nanmedian(np.abs(told - 0.25)) < 0.03


def test_saturated_samples_do_not_count_under_near_lamps_either():
    capture = shiny(0.25)
    clipped = replace(
        capture, images=np.asarray(capture.images).clip(max=0.6), saturation=np.full((len(LIGHTS), 3), 0.6)
    )
    near = replace(clipped, lamps=Lamps(1e6 * LIGHTS), camera=Camera(1.0))  # but far enough to be distant
    same(materials_of(clipped, capture.truth), materials_of(near, capture.truth))


def test_a_channel_that_is_saturated_leaves_what_the_others_tell():
    capture = shiny(0.35, albedo=(0.4, 0.04, 0.02))
    white = 0.05  # of red nothing else is seen, green and blue saturate in highlights alone
    seen = np.asarray(capture.images).clip(max=white)
    clipped = replace(capture, images=seen, saturation=np.full((len(LIGHTS), 3), white))
    found = materials_of(clipped, capture.truth)
    assert np.isfinite(middle(found.roughness)).mean() > 0.7
    assert np.nanmax(np.abs(middle(found.roughness) - 0.35)) < 0.05
    assert np.abs(np.median(middle(found.albedo)[:, 1:], axis=0) / [0.04, 0.02] - 1).max() < 0.05
    assert middle(found.albedo)[:, 0].min() >= 0.99 * white


def test_where_two_thirds_of_the_lights_are_in_shadow_the_others_tell():
    capture = shiny(0.35)
    images = np.array(capture.images)
    images[np.arange(len(LIGHTS)) % 3 > 0] *= 0.01
    found = materials_of(replace(capture, images=images), capture.truth)
    told = middle(found.roughness)
    assert np.isfinite(told).mean() > 0.2 and np.nanmax(np.abs(told - 0.35)) < 0.05
    assert np.abs(np.median(middle(found.albedo), axis=0) - [0.4, 0.3, 0.1]).max() < 0.01


def test_a_black_surface_that_mirrors_another_under_some_lights_is_not_told_as_metal():
    capture = shiny(0.5, albedo=(0.002, 0.002, 0.002), F0=(0.04, 0.04, 0.04))
    mirrored = 0.03 * (np.random.default_rng(0).random((len(LIGHTS), 1, 1, 1)) < 0.2) * capture.mask[..., None]
    seen = replace(capture, images=(np.asarray(capture.images) + mirrored).astype(np.float32))
    found = materials_of(seen, capture.truth)
    assert np.isfinite(middle(found.roughness)).mean() > 0.7 and not (found.metalness == 1).any()


@dataclass(frozen=True)
class WithoutLights:
    """A method that does without lights, and counts how often it is asked."""

    needs: ClassVar[Needs] = Needs(lights=False, reads="object")
    asked: ClassVar[list] = []

    def __call__(self, seen):
        self.asked.append(seen)
        return Solution(torch.tensor([0.0, 0.0, 1.0]).expand(len(seen.I), 3))


def test_without_lights_materials_are_refused_before_anything_is_computed(monkeypatch):
    monkeypatch.setitem(METHODS, "blind", f"{__name__}:WithoutLights")
    dark = replace(shiny(0.35), lights=None)
    with pytest.raises(InputError, match="has no light directions but materials need them"):
        pn.measure(dark, "blind", materials=True)
    assert not WithoutLights.asked
    pn.measure(dark, "blind", expected_error=False, examine=False)
    assert WithoutLights.asked


def test_the_command_writes_the_maps(tmp_path):
    write_diligent(tmp_path / "ball", shiny(0.35))
    words = ["measure", str(tmp_path / "ball"), "--method", "woodham", "--materials", "--no-mesh"]
    assert main([*words, "--out", str(tmp_path / "r")]) == 0
    maps = {n: decode(tmp_path / "r" / f"{n}.png") for n in ("base_colour", "roughness", "metalness", "specular")}
    known = decode(tmp_path / "r" / "material_known.png")[..., 0]
    assert {v.shape for v in maps.values()} == {(40, 40, 3), (40, 40, 1)} and maps["base_colour"].shape[2] == 3
    assert set(np.unique(known)) == {0, 128, 255} or set(np.unique(known)) == {0, 255}
    assert abs(np.median(maps["roughness"][known > 0]) / 255 - 0.35) < 0.1
    assert (maps["metalness"] > 0).mean() < 0.1
    assert set(json.loads((tmp_path / "r" / "report.json").read_text())["files"]) >= {f"{n}.png" for n in maps}


def test_an_albedo_fades_where_highlights_are_no_longer_told():
    where = torch.ones(30, 40, dtype=torch.bool)
    column = torch.arange(40).repeat(30)
    told = column < 20
    alone = torch.full((1200, 3), 0.5)
    rho = torch.where(told[:, None], 0.4, 0.3)
    shown = maps.blended(rho, alone, told, told, where).view(30, 40, 3)[15, :, 0]
    assert torch.allclose(shown[:20], torch.tensor(0.4)) and torch.allclose(shown[26:], torch.tensor(0.5))
    assert (shown.diff() >= -1e-6).all() and shown.diff().max() < 0.035  # it was a step of 0.1
    none = maps.blended(torch.where(told[:, None], 0.4, 0.5), alone, told, told, where).view(30, 40, 3)[15, :, 0]
    assert torch.allclose(none[20:], torch.tensor(0.5))  # their own samples show no highlight
