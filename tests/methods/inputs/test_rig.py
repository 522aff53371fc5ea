"""The lamps of a rig: found in any order, refused where they are others."""

import numpy as np
import pytest
import torch

from photonormal.geometry import fibonacci_hemisphere, rotation_about_view
from photonormal.methods.inputs.rig import lamps_of
from photonormal.types import InputError

RIG = torch.from_numpy(fibonacci_hemisphere(24)).float()


def test_lamps_are_found_in_any_order_and_a_little_off():
    order = torch.randperm(24, generator=torch.Generator().manual_seed(0))
    assert torch.equal(lamps_of(RIG[order], RIG), order)
    off = torch.from_numpy(RIG.numpy() @ rotation_about_view(2).T.astype(np.float32))
    assert torch.equal(lamps_of(off[order], RIG), order)
    assert torch.equal(lamps_of(off[order].expand(5, 24, 3), RIG), order)  # of five pixels


def test_lamps_nearer_to_each_other_than_a_measurement_errs_are_told_apart():
    pair = torch.tensor([[0.0, 0, 1], [0.02, 0, 1]])
    shifted = pair + torch.tensor([0.02, 0, 0])  # both are nearest to the second
    unit = torch.nn.functional.normalize
    assert lamps_of(unit(shifted, dim=-1), unit(pair, dim=-1)).tolist() == [0, 1]


def test_another_rig_is_refused_with_the_largest_angle():
    off = torch.from_numpy(RIG.numpy() @ rotation_about_view(10).T.astype(np.float32))
    assert RIG[:, 2].min() < 0.1  # so that a lamp at the rim is off by the whole turn
    with pytest.raises(InputError, match=r"light \d+ is (9\.9|10\.0) degrees from where .* train dpsn --lights FILE"):
        lamps_of(off, RIG)
    one = RIG.expand(5, 24, 3).clone()
    one[3, 7] = RIG[8]
    with pytest.raises(InputError, match=r"light 8 is .* degrees from where"):
        lamps_of(one, RIG)
    with pytest.raises(InputError, match=r"10 lights came but this network learned for a rig of 24"):
        lamps_of(RIG[:10], RIG)
