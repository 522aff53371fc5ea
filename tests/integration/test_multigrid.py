import numpy as np
import pytest

from photonormal.integration import bands
from photonormal.integration.conjugate import conjugate_gradients
from photonormal.integration.grid import Grid
from photonormal.integration.interpolation import Interpolation
from photonormal.integration.multigrid import DIRECT, Multigrid
from photonormal.integration.slopes import add_divergence, adjacent, weighted_laplacian


def jumping_weights(h: int, w: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Weights of a disc with a hole whose edges are cut along a bent line, and vary by a thousand elsewhere."""
    g = np.random.default_rng(seed)
    y, x = np.mgrid[:h, :w]
    r = np.hypot((y - h / 2) / h, (x - w / 2) / w)
    right, down = adjacent((r < 0.48) & (r > 0.1))
    side = x > w / 2 + 0.2 * w * np.sin(5 * y / h)
    cx, cy = (10 ** g.uniform(-3, 0, known.shape) * known for known in (right, down))
    return np.where(side[:, :-1] == side[:, 1:], cx, 1e-6 * cx), np.where(side[:-1] == side[1:], cy, 1e-6 * cy)


def energy(grid: Grid, z: np.ndarray) -> float:
    return float(sum((c * (z1 - z0) ** 2).sum() for c, z0, z1 in grid.edges(z)))


@pytest.mark.parametrize(("h", "w"), [(37, 52), (96, 96)])
def test_a_coarse_grid_has_the_energy_of_what_it_interpolates_to(h, w):
    grid = Grid.of(*(c.astype(np.float32) for c in jumping_weights(h, w)))
    for _ in range(2):
        between = Interpolation.of(grid)
        coarse = between.coarse(grid)
        v = np.random.default_rng(1).normal(size=coarse.inverse.shape).astype(np.float32)
        assert energy(coarse, v) == pytest.approx(energy(grid, between.prolonged(v)), rel=1e-4)
        grid = coarse


def test_restriction_is_the_adjoint_of_interpolation_which_keeps_a_constant():
    grid = Grid.of(*(c.astype(np.float32) for c in jumping_weights(40, 33)))
    between = Interpolation.of(grid)
    g = np.random.default_rng(2)
    v, r = (g.normal(size=s).astype(np.float32) for s in (between.coarse(grid).inverse.shape, grid.inverse.shape))
    v[len(between.west) :], v[:, between.north.shape[1] :] = 0, 0
    assert (between.prolonged(v) * r).sum() == pytest.approx((v * between.restricted(r)).sum(), rel=1e-3)
    known = grid.inverse > 0
    assert np.abs(between.prolonged(np.ones_like(v))[known] - 1).max() < 1e-5


def test_a_cycle_is_symmetric():
    cx, cy = jumping_weights(50, 60)
    cycle = Multigrid(cx, cy)
    a, b = np.random.default_rng(3).normal(size=(2, 50, 60)).astype(np.float32)
    assert (a * cycle(b)).sum() == pytest.approx((cycle(a) * b).sum(), rel=1e-3)


def test_rows_that_are_worked_on_by_themselves_give_the_same(monkeypatch):
    cx, cy = jumping_weights(150, 97)
    r = np.random.default_rng(5).normal(size=(150, 97)).astype(np.float32)
    whole = Multigrid(cx, cy)(r)
    for name, value in {"BLOCK": 1, "LEAST": 3, "WORTH": 0, "cores": lambda: 3}.items():
        monkeypatch.setattr(bands, name, value)
    assert np.abs(Multigrid(cx, cy)(r) - whole).max() < 1e-5 * np.abs(whole).max()


@pytest.mark.parametrize("size", [65, 128, 260])
def test_few_iterations_solve_any_size_across_jumps(size):
    cx, cy = jumping_weights(size, size + 7)
    g = np.random.default_rng(4)
    rhs = np.zeros((size, size + 7))
    add_divergence(rhs, cx * g.normal(size=cx.shape), cy * g.normal(size=cy.shape))
    z, done = conjugate_gradients(
        lambda z, rows: weighted_laplacian(z, cx, cy, rows),
        rhs,
        np.zeros_like(rhs),
        Multigrid(cx, cy),
        1e-5,
        40,
        np.float32,
    )
    assert done
    assert np.linalg.norm(rhs - weighted_laplacian(z, cx, cy, slice(0, size))) <= 1.01e-5 * np.linalg.norm(rhs)


def test_no_edges_give_nothing():
    z = Multigrid(np.zeros((20, 29)), np.zeros((19, 30)))(np.zeros((20, 30), np.float32))
    assert (z == 0).all()


@pytest.mark.parametrize(("h", "w"), [(1, 900), (2, 601), (3, 600), (600, 3), (20, 4000)])
def test_a_strip_becomes_coarse_along_its_length(h, w):
    """Else its last grid would be solved as one matrix, with the square of its length in numbers; and it converges."""
    cx, cy = np.ones((h, w - 1), np.float32), np.ones((h - 1, w), np.float32)
    cycle = Multigrid(cx, cy)
    assert len(cycle.coarsest) <= DIRECT
    truth = np.add.outer(np.sin(np.arange(h) / 2), 10 * np.sin(np.arange(w) / 40))
    truth -= truth.mean()
    b = weighted_laplacian(truth, cx, cy, slice(0, h))
    z, converged = conjugate_gradients(
        lambda z, rows: weighted_laplacian(z, cx, cy, rows), b, np.zeros((h, w)), cycle, 1e-6, 30
    )
    assert converged and np.abs(z - z.mean() - truth).max() < 1e-2
