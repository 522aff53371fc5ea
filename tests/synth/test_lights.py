"""Sets of light directions."""

import numpy as np
import pytest

from photonormal.synth.lights import KINDS, draw_lights
from photonormal.types import InputError


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 3, 17, 96, 300])
def test_lights_are_unit_and_above_the_horizon(kind, n):
    l = draw_lights(np.random.default_rng(0), 3, n, 0.5, kind)
    assert l.shape == (3, n, 3)
    assert np.allclose(np.linalg.norm(l, axis=-1), 1)
    assert (l[..., 2] > 0.05).all()
    if n > 1:
        assert len(np.unique(l[0].round(6), axis=0)) == n


def test_narrow_sets_are_as_narrow_as_diligents_and_wide_ones_are_not():
    g = np.random.default_rng(1)
    for kind in ("grid", "box"):
        l = draw_lights(g, 50, 64, 1.0, kind)
        assert l[..., 2].min() > 0.66
        assert np.abs(l[..., :2]).max() < 0.72
        assert np.quantile(np.abs(l[..., :2]), 0.95) > 0.35
    wide = draw_lights(g, 50, 64, 0.0)
    assert (np.abs(wide[..., 2]) < 0.5).mean() > 0.3


def test_an_unknown_rig_is_refused():
    with pytest.raises(InputError, match="no light rig 'lamp'; use mixed, hemisphere"):
        draw_lights(np.random.default_rng(0), 1, 4, 0.5, "lamp")
