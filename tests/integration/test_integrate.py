import tracemalloc

import numpy as np
import pytest

from photonormal.integration import METHODS, integrate
from photonormal.integration.slopes import Slopes, surface
from photonormal.types import InputError, Normals

ANY_MASK = ["quadratic", "bilateral"]
OBJECTS = [m for m in METHODS if m != "periodic"]  # whose edges need not meet; tiles: tests/export/test_heights.py


def surface_normals(z_x: np.ndarray, z_y: np.ndarray, mask: np.ndarray) -> Normals:
    """Normals of a height z with slopes z_x to the right and z_y upwards."""
    n = np.stack([-z_x, -z_y, np.ones_like(z_x)], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return Normals(np.where(mask[..., None], n, 0).astype(np.float32), mask)


def hills(size: int, mask: np.ndarray | None = None) -> tuple[Normals, np.ndarray]:
    """A smooth landscape on `size` pixels, the same at every resolution; normals and heights in pixels."""
    v, u = np.mgrid[0.5:size, 0.5:size] / size
    x, y = u, 1 - v
    a = 2 * np.pi
    z = 0.06 * np.sin(a * x) * np.cos(a * y) + 0.1 * x * y
    z_x = 0.06 * a * np.cos(a * x) * np.cos(a * y) + 0.1 * y
    z_y = -0.06 * a * np.sin(a * x) * np.sin(a * y) + 0.1 * x
    mask = np.ones((size, size), bool) if mask is None else mask
    return surface_normals(z_x, z_y, mask), size * z


def residual(depth: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> float:
    """Root mean square of the difference after one constant."""
    difference = (depth - truth)[mask]
    return float((difference - difference.mean()).std())


def disc(size: int, x: float, y: float, r: float) -> np.ndarray:
    v, u = np.mgrid[:size, :size]
    return (u - x * size) ** 2 + (v - y * size) ** 2 < (r * size) ** 2


@pytest.mark.parametrize("method", OBJECTS)
def test_integrating_the_normals_of_a_height_gives_the_height(method):
    normals, z = hills(64)
    assert residual(integrate(normals, method).depth, z, normals.mask) < 0.004 * np.ptp(z)


@pytest.mark.parametrize("method", OBJECTS)
def test_the_error_falls_with_the_square_of_the_resolution(method):
    errors = []
    for size in (32, 64):
        normals, z = hills(size)
        options = {} if method == "simchony" else {"tolerance": 1e-8}
        errors.append(residual(integrate(normals, method, **options).depth, z, normals.mask) / size)
    assert errors[0] / errors[1] > 3.3  # of 4


def ball(size: int) -> tuple[Normals, np.ndarray]:
    """A ball out to where its slope is 2.7; normals and heights in pixels."""
    mask = disc(size, 0.5, 0.5, 0.47)
    v, u = np.mgrid[:size, :size] - 0.5 * size
    z = np.sqrt(np.maximum((0.5 * size) ** 2 - u**2 - v**2, 1))
    return surface_normals(-u / z, v / z, mask), z


def test_least_squares_is_exact_on_a_sphere():
    normals, z = ball(48)
    assert residual(integrate(normals, "quadratic").depth, z, normals.mask) < 1e-4


def test_combined_equations_follow_a_bend_more_closely_than_one_sided_ones():
    normals, z = ball(96)
    ours, paper = (integrate(normals, "bilateral", combined=m).depth for m in (2, 0))
    assert residual(ours, z, normals.mask) < 0.7 * residual(paper, z, normals.mask)


@pytest.mark.parametrize("method", OBJECTS)
def test_a_tilted_plane_is_exact(method):
    mask = np.ones((20, 31), bool)
    normals = surface_normals(np.full(mask.shape, 0.5), np.full(mask.shape, -2.0), mask)
    v, u = np.mgrid[:20, :31]
    assert residual(integrate(normals, method).depth, 0.5 * u + 2.0 * v, mask) < 1e-3


@pytest.mark.parametrize("method", OBJECTS)
def test_facing_the_camera_is_level(method):
    mask = disc(40, 0.5, 0.5, 0.4)
    depth = integrate(surface_normals(np.zeros((40, 40)), np.zeros((40, 40)), mask), method).depth
    assert np.abs(depth[mask]).max() < 1e-6 and np.isnan(depth[~mask]).all()


@pytest.mark.parametrize("method", OBJECTS)
def test_mirrored_normals_give_the_mirrored_surface(method):
    normals, _ = hills(48, disc(48, 0.45, 0.5, 0.4))
    mirrored = Normals(normals.map[:, ::-1] * np.array([-1, 1, 1], np.float32), normals.mask[:, ::-1])
    a, b = (integrate(n, method).depth for n in (normals, mirrored))
    assert np.nanmax(np.abs(a - b[:, ::-1])) < 0.02 * np.nanmax(np.abs(a))


@pytest.mark.parametrize("method", ANY_MASK)
def test_parts_and_holes(method):
    size = 64
    mask = (disc(size, 0.25, 0.3, 0.2) & ~disc(size, 0.25, 0.3, 0.07)) | disc(size, 0.7, 0.7, 0.25)
    mask[2, 60] = True  # a pixel on its own
    normals, z = hills(size, mask)
    depth = integrate(normals, method).depth
    left = mask & disc(size, 0.25, 0.3, 0.2)
    for part in (left, mask & disc(size, 0.7, 0.7, 0.25)):
        assert residual(depth, z, part) < 0.01 * np.ptp(z)
        assert abs(depth[part].mean()) < 1e-6
    assert depth[2, 60] == 0


@pytest.mark.parametrize("method", OBJECTS)
@pytest.mark.parametrize("camera", [None, np.array([[50.0, 0, 3], [0, 50.0, 2], [0, 0, 1]])])
def test_pixels_without_neighbours_and_normals_that_look_away(method, camera):
    mask = np.zeros((5, 7), bool)
    mask[::2, ::2] = True
    v = np.array([0.6, 0.0, -0.8])
    depth = integrate(Normals(np.where(mask[..., None], v, 0), mask), method, K=camera).depth
    assert (depth[mask] == (0 if camera is None else 1)).all()
    row = np.zeros((5, 7), bool)
    row[2] = True
    depth = integrate(Normals(np.where(row[..., None], v, 0), row), method, K=camera).depth
    assert np.isfinite(depth[row]).all() and (np.diff(depth[2]) * (1 if camera is not None else -1) > 0).all()


@pytest.mark.parametrize("method", OBJECTS)
def test_a_crop_changes_nothing_once_the_principal_point_moves_with_it(method):
    mask = disc(40, 0.5, 0.5, 0.25)
    normals, _ = hills(40, mask)
    K = np.array([[300.0, 0, 19.5], [0, 310.0, 18.0], [0, 0, 1]])
    whole = integrate(normals, method, K=K)
    crop = Normals(normals.map[8:33, 5:36], mask[8:33, 5:36])
    part = integrate(crop, method, K=K - np.array([[0, 0, 5], [0, 0, 8], [0, 0, 0]]))
    assert np.abs(whole.depth[8:33, 5:36] - part.depth)[crop.mask].max() < 1e-9
    assert whole.depth[mask].mean() == pytest.approx(1)


def crack(height: float = 24.0, size: int = 48) -> tuple[Normals, np.ndarray]:
    """A level ground whose left half rises towards the bottom: a step that opens from nothing to `height`."""
    v, u = np.mgrid[:size, :size].astype(float)
    left = u < size // 2
    z = np.where(left, height * (v / size) ** 2, 0)
    z_y = np.where(left, -2 * height * v / size**2, 0)
    return surface_normals(np.zeros_like(z), z_y, np.ones((size, size), bool)), z


def test_bilateral_keeps_a_step_where_least_squares_smears_it():
    normals, z = crack()
    error = {method: residual(integrate(normals, method).depth, z, normals.mask) for method in ANY_MASK}
    assert error["bilateral"] < 0.3 * error["quadratic"]


K = np.array([[120.0, 0, 31.5], [0, 110.0, 29.5], [0, 0, 1]])


def rays(size: int = 64) -> np.ndarray:
    """Rays through the pixels, x right, y up, z to the camera, of unit length along the optical axis."""
    v, u = np.mgrid[:size, :size].astype(float)
    return np.stack([(u - K[0, 2]) / K[0, 0], -(v - K[1, 2]) / K[1, 1], -np.ones_like(u)], axis=-1)


@pytest.mark.parametrize("method", OBJECTS)
def test_a_tilted_plane_in_perspective(method):
    n = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    Z = -1 / (rays() @ n)  # the plane n.P = -1
    mask = np.ones(Z.shape, bool)
    depth = integrate(Normals(np.broadcast_to(n, (*mask.shape, 3)).astype(np.float32), mask), method, K=K).depth
    ratio = depth / Z
    assert ratio.std() / ratio.mean() < 1e-4


@pytest.mark.parametrize("method", ANY_MASK)
def test_a_sphere_in_perspective(method):
    r, centre = rays(), np.array([0.1, 0.05, -5.0])
    a, b, c = (r**2).sum(-1), r @ centre, centre @ centre - 0.9**2
    hit = b**2 - a * c
    Z = np.where(hit > 0, (b - np.sqrt(np.maximum(hit, 0))) / a, np.nan)
    n = (Z[..., None] * r - centre) / 0.9
    mask = (hit > 0) & (-(n * r).sum(-1) / np.sqrt(a) > 0.3)
    depth = integrate(Normals(np.where(mask[..., None], n, 0).astype(np.float32), mask), method, K=K).depth
    ratio = (depth / Z)[mask]
    assert ratio.std() / ratio.mean() < 0.001


def test_what_cannot_be_integrated_is_refused():
    normals, _ = hills(16)
    with pytest.raises(InputError, match="no integration 'magic'; choose from simchony, quadratic, bilateral"):
        integrate(normals, "magic")
    with pytest.raises(InputError, match="bilateral has no option 'sharpness'; it has k"):
        integrate(normals, "bilateral", sharpness=3)
    with pytest.raises(InputError, match="3 x 3 finite numbers"):
        integrate(normals, K=np.eye(4))
    with pytest.raises(InputError, match="positive focal lengths"):
        integrate(normals, K=np.diag([-100.0, 100, 1]))
    with pytest.raises(InputError, match=r"grazing is 2\.0 but a cosine between 0 and 1 is needed"):
        integrate(normals, grazing=2.0)
    with pytest.raises(InputError, match=r"k is -1\.0 and"):
        integrate(normals, "bilateral", k=-1.0)
    with pytest.raises(InputError, match=r"combined is 2 and outlier_deg 0\.0; no fewer than 0 rounds"):
        integrate(normals, "bilateral", outlier_deg=0.0)
    with pytest.raises(InputError, match="no pixel has a normal"):
        integrate(Normals(np.zeros((4, 4, 3)), np.zeros((4, 4), bool)))


@pytest.mark.data
@pytest.mark.parametrize(("name", "published_mm"), [("bear", 0.334), ("cat", 0.074), ("reading", 0.257)])
def test_depth_of_real_objects_is_as_good_as_published(data, name, published_mm):
    from integrate import depth_error_mm, real_object

    normals, camera, depth_mm = real_object(data, name)
    assert depth_error_mm(integrate(normals, "bilateral", K=camera), depth_mm) <= published_mm


def test_memory_is_the_picture_s_however_many_parts_it_has():
    mask = np.indices((256, 4096)).sum(0) % 2 == 0
    normals = Normals(np.where(mask[..., None], np.float32([0, 0, 1]), np.float32(0)), mask)
    z = np.random.default_rng(0).normal(size=mask.shape)
    tracemalloc.start()
    depth = surface(z, Slopes(normals, None, 0.05)).depth
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.abs(depth[mask]).max() == 0  # of a part of one pixel
    assert peak < 40 * mask.size


def test_each_part_of_a_tile_has_a_mean_of_zero():
    v, u = np.mgrid[:24, :24] / 24 * 2 * np.pi
    mask = np.ones((24, 24), bool)
    mask[:, [8, 13]] = False
    mask[[5, 20]] = False
    amount = 2 * np.pi / 24
    normals = surface_normals(amount * np.cos(u + 0.4) * np.cos(v), amount * np.sin(u + 0.4) * np.sin(v), mask)
    depth = integrate(normals, "periodic").depth
    for rows in (range(6, 20), [*range(21, 24), *range(5)]):
        for columns in (range(9, 13), [*range(14, 24), *range(8)]):
            part = depth[np.ix_(rows, columns)]
            assert abs(part.mean()) < 1e-6 < part.std()


@pytest.mark.parametrize("method", ANY_MASK)
@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.55])
def test_a_mask_that_falls_into_many_parts(method, share):
    for seed in range(4):
        mask = np.random.default_rng(seed).random((60, 60)) < share
        normals, z = hills(60, mask)
        depth = integrate(normals, method).depth
        assert np.abs(depth[mask]).max() < np.ptp(z)
        assert np.abs(np.diff(depth - z))[mask[:, 1:] & mask[:, :-1]].mean() < 0.02
