"""What changes from pixel to pixel."""

import torch

from photonormal.methods.inputs.edges import gradient


def test_a_slope_changes_alike_inside():
    y, x = torch.meshgrid(torch.arange(6.0), torch.arange(8.0), indexing="ij")
    across, down = gradient(torch.stack([2 * x + 3 * y, x * y]))  # (2, h, w) each
    assert (across[0, :, 1:-1] == 2).all() and (down[0, 1:-1] == 3).all()
    torch.testing.assert_close(across[1, :, 1:-1], y[:, 1:-1])
    torch.testing.assert_close(down[1, 1:-1], x[1:-1])
