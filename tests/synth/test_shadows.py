"""Cast shadows of height fields whose shadows are known."""

import math

import pytest
import torch
import torch.nn.functional as F

from photonormal.synth.shadows import distant, nearby
from photonormal.synth.trace import NOWHERE

S = 64
PIXELS = torch.arange(S * S)[None].int()


def light(azimuth_deg: float, elevation_deg: float) -> torch.Tensor:
    a, e = math.radians(azimuth_deg), math.radians(elevation_deg)
    return torch.tensor([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])


def solid(height: torch.Tensor, leaves: float = NOWHERE, enters: float = NOWHERE) -> torch.Tensor:
    """Heights, solid all the way down; or where they are above `enters` only down to `leaves`, with `enters` below."""
    lifted = height > enters + 1
    below = torch.where(lifted, leaves, NOWHERE), torch.where(lifted, enters, NOWHERE)
    return torch.stack([height, *below])[None]


def visibility(
    height: torch.Tensor, *lights: torch.Tensor, normals: torch.Tensor | None = None, **room
) -> torch.Tensor:
    up = torch.tensor([0.0, 0, 1]).view(3, 1, 1).expand(3, S, S)
    n = (up if normals is None else normals).reshape(1, 3, -1)
    return distant(solid(height, **room), torch.stack(lights)[None], PIXELS, n)[0].view(-1, S, S)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize("elevation", [30, 45, 60])
def test_a_step_casts_a_shadow_as_long_as_its_height_over_the_tangent(turns, elevation):
    height = torch.zeros(S, S)
    height[:, :32] = 12  # high on the left, light from the left
    v = visibility(torch.rot90(height, turns), light(180 + 90 * turns, elevation))[0]
    shadow = torch.rot90(v, -turns)[S // 2, 32:] < 0.5
    assert shadow.sum() == pytest.approx(12 / math.tan(math.radians(elevation)), abs=1.1)
    assert shadow[: int(shadow.sum())].all()  # next to the step, in one piece


def test_an_oblique_shadow_keeps_its_length_along_the_light():
    height = torch.zeros(S, S)
    height[20:24, 20:24] = 10
    v = visibility(height, light(135, 45))[0]  # from the upper left; the shadow falls to the lower right
    dark = ((v < 0.5) & (height == 0)).nonzero().float()
    reach = (dark - torch.tensor([23.0, 23.0])).norm(dim=1).max()  # from the block's last pixel
    assert reach == pytest.approx(10, abs=1.6)
    assert (dark >= 20).all()


@pytest.mark.parametrize("azimuth", range(0, 360, 35))
def test_planes_and_domes_shadow_nothing(azimuth):
    y, x = torch.meshgrid(torch.linspace(-1, 1, S), torch.linspace(1, -1, S), indexing="ij")
    plane = 10 * x + 7 * y
    l = light(azimuth, 50)
    assert visibility(plane, l).min() > 0.99
    x, y = -(S / 2 - 0.5) * x, (S / 2 - 0.5) * -y  # pixels
    dome = (2600 - x**2 - y**2).sqrt()
    n = torch.stack([x, y, dome]) / 2600**0.5
    lit = (n * l[:, None, None]).sum(0) > 0.05
    assert (visibility(dome, l, normals=n)[0][lit] > 0.9).float().mean() > 0.999


def test_agrees_with_marching_towards_each_light():
    noise = F.interpolate(torch.randn(1, 1, 9, 9, generator=torch.Generator().manual_seed(1)), (S, S), mode="bicubic")
    height = 9 * noise[0, 0]
    lights = [light(a, e) for a, e in ((10, 30), (100, 45), (200, 25), (251, 60), (315, 40))]
    v = visibility(height, *lights)
    y, x = torch.meshgrid(torch.arange(S), torch.arange(S), indexing="ij")
    for l, seen in zip(lights, v, strict=True):
        depth = torch.full((S, S), -torch.inf)
        for t in torch.arange(1, 60, 0.5):
            c, r = x + t * l[0] / l[:2].norm(), y - t * l[1] / l[:2].norm()
            grid = torch.stack([c, r], -1) * 2 / (S - 1) - 1
            h = F.grid_sample(height[None, None], grid[None].float(), align_corners=True)[0, 0]
            inside = (grid.abs() <= 1).all(-1)
            depth = torch.where(inside, torch.maximum(depth, h - t * l[2] / l[:2].norm()), depth)
        sure = (depth - height - 0.3).abs() > 0.6  # away from the shadow's edge
        assert ((depth - height > 0.3) == (seen < 0.5))[sure].float().mean() > 0.985


def test_nothing_casts_no_shadow_and_a_light_overhead_none_either():
    height = torch.full((S, S), -1000.0)
    height[30:40, 30:40] = 5
    assert visibility(height, light(0, 20))[0][30:40, 30:40].min() == 1
    height = torch.zeros(S, S)
    height[:, :20] = 15
    assert visibility(height, torch.tensor([0.0, 0.0, 1.0])).min() == 1


def ends(dark: torch.Tensor) -> tuple[float, float]:
    """First and last of the pixels that are set, which are in one piece."""
    first, last = dark.nonzero()[[0, -1], 0].tolist()
    assert dark[first : last + 1].all()
    return first, last + 1


@pytest.mark.parametrize("elevation", [30, 45])
def test_light_passes_below_a_bridge(elevation):
    height = torch.zeros(S, S)
    height[:, 30:34] = 16  # four columns wide
    l, along = light(180, elevation), 1 / math.tan(math.radians(elevation))
    first, last = ends(visibility(height, l, leaves=12, enters=0)[0, S // 2, 34:] < 0.5)
    assert first == pytest.approx(12 * along - 4, abs=1.5)  # below the edge that is nearer to the light
    assert last == pytest.approx(16 * along, abs=1.5)
    assert ends(visibility(height, l)[0, S // 2, 34:] < 0.5) == (0, last)  # below a wall nothing passes


def test_light_passes_through_a_ring_over_the_ground_but_not_through_the_ring():
    y, x = torch.meshgrid(torch.arange(S) - 20.0, torch.arange(S) - 20.0, indexing="ij")
    r = (x**2 + y**2).sqrt()
    height = torch.where((r - 10).abs() < 3, 22.0, 0.0)
    v = visibility(height, light(135, 45), leaves=20, enters=0)[0]
    x, y = x - 20 / 2**0.5, y - 20 / 2**0.5  # from the upper left: the ring's shadow lies as far away as it is high
    r = (x**2 + y**2).sqrt()
    ground = height == 0
    assert v[ground & ((r - 10).abs() < 1)].max() < 0.5
    assert v[ground & ((r < 5) | ((r > 16) & (x > 0) & (y > 0)))].min() > 0.5


def test_a_wall_below_a_bridge_casts_a_shadow_of_its_own():
    height = torch.zeros(S, S)
    height[:, 30:34] = 20
    dark = visibility(height, light(180, 45), leaves=16, enters=8)[0, S // 2, 34:] < 0.5
    assert ends(dark[:10]) == (0, pytest.approx(8, abs=1.5))
    assert ends(dark[10:]) == (pytest.approx(16 - 4 - 10, abs=1.5), pytest.approx(20 - 10, abs=1.5))


def lamp_visibility(height: torch.Tensor, *lamps: list[float], **room) -> torch.Tensor:
    """Lamps at (x, y, height) from the middle of the picture."""
    S_ = torch.tensor(lamps) * torch.tensor([1.0, -1, 1]) + torch.tensor([(S - 1) / 2, (S - 1) / 2, 0])
    return nearby(solid(height, **room), S_[None], PIXELS)[0].view(-1, S, S)


@pytest.mark.parametrize("turns", [0, 1])
def test_a_lamp_s_shadow_is_as_long_as_similar_triangles_say(turns):
    height = torch.zeros(S, S)
    height[:, :32] = 12  # its edge is at x = 0; a lamp 20 to the left of it and 48 up
    lamp = [-20.0, 0, 48]
    if turns:
        height, lamp = torch.rot90(height), [0, -20.0, 48]
    shadow = torch.rot90(lamp_visibility(height, lamp)[0], -turns)[S // 2, 32:] < 0.5
    assert shadow.sum() == pytest.approx(12 * 20 / (48 - 12), abs=1.1)
    assert shadow[: int(shadow.sum())].all()


def test_a_lamp_shines_below_a_bridge():
    height = torch.zeros(S, S)
    height[:, 30:34] = 16
    dark = lamp_visibility(height, [-30.0, 0, 40], leaves=12, enters=0)[0, S // 2, 34:] < 0.5
    lower, upper = (x + (30 + x) * h / (40 - h) - 2 for x, h in ((-2, 12), (2, 16)))  # from the bridge's far edge
    assert ends(dark) == (pytest.approx(lower, abs=1.5), pytest.approx(upper, abs=1.5))


def test_lamps_far_away_cast_the_shadows_of_distant_lights():
    torch.manual_seed(0)
    height = 20 * F.interpolate(torch.rand(1, 1, 6, 6), size=(S, S), mode="bicubic")[0, 0]
    L = torch.stack([light(30, 30), light(200, 45), light(100, 70)])
    near = lamp_visibility(height, *(1e5 * L).tolist())
    assert (near - visibility(height, *L)).abs().mean() < 0.02
