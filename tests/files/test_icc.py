"""Tone curves of colour profiles, against what the specification says of each kind."""

import numpy as np
import pytest

from photonormal.files.icc import read_profile
from photonormal.srgb import to_linear
from tests.capture.embedding import curv, para, profile

X = np.linspace(0, 1, 101)
SRGB_PARAMETERS = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
TABLE = tuple(np.rint(65535 * np.linspace(0, 1, 1024) ** 1.8).astype(int).tolist())


@pytest.mark.parametrize(
    ("tag", "linear"),
    [
        (curv(), X),
        (curv(256), X),
        (curv(563), X ** (563 / 256)),
        (curv(0, 65535), X),
        (curv(*TABLE), X**1.8),
        (para(0, 2.2), X**2.2),
        (para(1, 2, 1.25, -0.25), np.where(X >= 0.2, (1.25 * X - 0.25) ** 2, 0)),
        (para(2, 2, 1.25, -0.25, 0.5), (np.where(X >= 0.2, (1.25 * X - 0.25) ** 2, 0) + 0.5) / 1.5),
        (para(3, *SRGB_PARAMETERS), to_linear(X)),
        (para(4, *SRGB_PARAMETERS, 0, 0), to_linear(X)),
    ],
)
def test_each_kind_of_curve(tag, linear):
    for curves in ((tag,), (tag, tag, tag)):
        found = read_profile(profile(*curves, name="Studio"))
        assert found is not None and found.name == "Studio"
        np.testing.assert_allclose(found.curves[0](X), linear, atol=3e-4)


def test_channels_may_differ():
    found = read_profile(profile(curv(), curv(512), curv(256)))
    assert found is not None
    assert [float(curve(np.array([0.5]))[0]) for curve in found.curves] == pytest.approx([0.5, 0.25, 0.5])


def test_a_profile_without_curves_has_none():
    assert read_profile(profile()) is None


@pytest.mark.parametrize(
    "tag", [b"", b"curv", curv(65535, 0), curv(0, 0), para(0, 2.2)[:12], b"para\0\0\0\0\0\x09\0\0"]
)
def test_damaged_ones_have_none(tag):
    assert read_profile(profile(tag)) is None


@pytest.mark.parametrize("end", [0, 20, 40, 130, 140, 180])
def test_cut_ones_have_none(end):
    assert read_profile(profile(curv(563))[:end]) is None


def test_a_branch_that_is_not_taken_may_overflow():
    found = read_profile(profile(para(3, 9000, 2, 0, 1, 2)))
    assert found is not None
    np.testing.assert_allclose(found.curves[0](X), X)
