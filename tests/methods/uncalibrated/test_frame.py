"""What tells the frame that matt shading leaves open: albedo that does not follow the normals, and highlights."""

import numpy as np
import pytest
import torch

from photonormal.geometry import angle_deg
from photonormal.methods.uncalibrated.albedo import unshaded
from photonormal.methods.uncalibrated.frame import BASRELIEF, Believed, FrameEvidence, settled
from photonormal.methods.uncalibrated.highlights import highlights
from photonormal.methods.uncalibrated.shown import ShownPixels
from tests.methods.uncalibrated.test_refine import scattered, shaken
from tests.scenes import sphere

TOLD = np.array([0.08, -0.06, 0.1])


def seen(shine: float) -> tuple[ShownPixels, torch.Tensor, torch.Tensor]:
    """A matt or shiny sphere, its normals and lights."""
    truth, L = sphere(64, rim=0.9), scattered(40).astype(np.float32)
    n = truth.map[truth.mask]
    halfway = L + np.array([0, 0, 1], np.float32)
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    shading = (n @ L.T).clip(0)
    I = torch.from_numpy(shading * (1 + shine * (n @ halfway.T).clip(0) ** 60))
    return ShownPixels(I, I > 0, torch.from_numpy(truth.mask), I.T[:, :1]), torch.from_numpy(n), torch.from_numpy(L)


def moved(N: torch.Tensor, s: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Normals, of unit length, and lights in a frame from which TOLD leads back, and the normals' lengths there."""
    A = torch.eye(3)
    A[:, 2] += torch.from_numpy(TOLD).float()
    b = N @ A.T  # s A^-1 and b A^T give the same pictures
    return torch.nn.functional.normalize(b, dim=1), s @ torch.linalg.inv(A), b.norm(dim=1)


def sd(evidence) -> np.ndarray:
    return torch.linalg.inv(evidence.precision).diagonal().sqrt().numpy()


def test_albedo_leads_back_into_the_frame_where_it_is_even():
    shown, N, s = seen(0)
    there, _, rho = moved(N, s)
    told, right = unshaded(rho, there, shown.inside, 40), unshaded(torch.ones(len(N)), N, shown.inside, 40)
    np.testing.assert_allclose(told.told.numpy(), TOLD, atol=0.02)
    np.testing.assert_allclose(right.told.numpy(), 0, atol=1e-3)
    assert (sd(told) < 0.15).all()


def test_texture_makes_albedo_doubtful():
    shown, N, _ = seen(0)
    texture = 1 + 0.5 * torch.sin(9 * N[:, 0]) * torch.cos(7 * N[:, 1] + N[:, 0])
    even, textured = (unshaded(rho, N, shown.inside, 40) for rho in (torch.ones(len(N)), texture))
    assert (sd(textured) > 2 * sd(even)).all()


def test_highlights_lead_back_into_the_frame():
    shown, N, s = seen(1)
    there, lights, _ = moved(N, s)
    told, right = highlights(shown, there, lights), highlights(shown, N, s)
    assert (told.told.numpy()[:2] / TOLD[:2] > 0.3).all() and (told.told.numpy()[:2] / TOLD[:2] < 2).all()
    np.testing.assert_allclose(right.told.numpy()[:2], 0, atol=0.01)
    assert (sd(told)[:2] < 0.1).all()


@pytest.mark.parametrize("shift", [False, True])
def test_a_matt_surface_has_no_highlights_that_tell_anything(shift):
    shown, N, s = seen(0)
    told = highlights(shown, *(moved(N, s)[:2] if shift else (N, s)))
    assert torch.isfinite(told.precision).all() and (sd(told)[:2] > 1).all()


def test_large_errors_of_each_lights_own_leave_the_frame_as_it_is():
    L = scattered(2000)
    wrong = torch.from_numpy(shaken(L, 15)).float()
    right = torch.from_numpy(L).float()
    assert angle_deg(settled(right, Believed(wrong, 2000.0, torch.ones(2000)), []).numpy(), L).mean() < 1


def test_the_more_believed_lights_may_share_of_an_error_the_more_other_evidence_counts():
    L = torch.from_numpy(scattered(40)).float()
    flatter = torch.nn.functional.normalize(L * torch.tensor([1.0, 1.0, 0.8]), dim=1)
    deeper = FrameEvidence(BASRELIEF, torch.zeros(3).double(), torch.eye(3).double() / 0.05**2)
    left = [
        angle_deg(settled(L, Believed(flatter, 3.0, torch.ones(40), off=off), [deeper]).numpy(), L.numpy()).mean()
        for off in (0.0, 0.2)
    ]
    assert left[1] < 0.5 * left[0]


def test_too_few_pixels_tell_nothing():
    shown, N, s = seen(1)
    assert highlights(shown, N * (torch.arange(len(N)) < 50)[:, None], s) is None
    assert unshaded((torch.arange(len(N)) < 50).float(), N, shown.inside, 40) is None
