"""Reflectance is non-negative, the same when light and view change places, and no more than all the light."""

import math

import numpy as np
import pytest
import torch

from photonormal.synth.brdf.abc import ABC
from photonormal.synth.brdf.merl import SHAPE, Merl, read_merl
from photonormal.synth.brdf.neural import half_difference
from photonormal.synth.brdf.principled import Principled
from photonormal.synth.brdf.sgd import SGD
from photonormal.synth.library import HELD_OUT_EVERY, albedo, data_folder, library, named
from photonormal.types import InputError

G = torch.Generator().manual_seed(0)


def principled(k: int = 200) -> Principled:
    values = torch.rand(k, 11, 1, generator=G)
    values[:, 4] = 0.15 + 0.85 * values[:, 4]
    return Principled(values)


def sgd_example() -> SGD:
    p = [0.2, 0.3, 0.05, 0.6, 0.06, -0.5, 60.0, 3.0, 1e-6, 40.0, 0.2]
    return SGD(torch.tensor(p)[:, None, None].expand(11, 3, 1)[None])


def abc_example() -> ABC:
    return ABC(torch.tensor([0.3, 0.2, 0.1, 40.0, 40.0, 40.0, 5000.0, 0.9, 1.5])[None, :, None])


def directions(m: int = 64) -> tuple[torch.Tensor, ...]:
    """Cosines of m random pairs of light and view, (1, m) each, and of the pairs exchanged."""
    l, v = (torch.nn.functional.normalize(torch.randn(m, 3, generator=G), dim=1) for _ in range(2))
    l[:, 2], v[:, 2] = l[:, 2].abs().clamp(min=0.1), v[:, 2].abs().clamp(min=0.1)
    l, v = (torch.nn.functional.normalize(x, dim=1) for x in (l, v))
    h = torch.nn.functional.normalize(l + v, dim=1)
    return l[None, :, 2], v[None, :, 2], h[None, :, 2], (l * h).sum(1)[None]


@pytest.mark.parametrize("model", [principled(), sgd_example(), abc_example()], ids=["principled", "sgd", "abc"])
def test_reciprocal_and_not_negative(model):
    cos_l, cos_v, cos_h, cos_d = directions()
    f = model(cos_l, cos_v, cos_h, cos_d)
    assert f.shape[-2:] == (3, 64)
    assert (f >= 0).all() and f.isfinite().all()
    assert torch.allclose(f, model(cos_v, cos_l, cos_h, cos_d), rtol=1e-4, atol=1e-6)


def test_principled_gives_back_less_light_than_it_gets():
    values = torch.rand(300, 11, 1, generator=G)
    values[:, 4] = 0.3 + 0.7 * values[:, 4]
    values[:, [7, 9]] = 0  # sheen and coat are added on top and may exceed it
    assert albedo(Principled(values)).max() <= 1.0


def test_a_white_rough_dielectric_without_highlight_is_about_lambertian():
    values = torch.tensor([1.0, 1, 1, 0, 0.25, 0, 0, 0, 0, 0, 0])[None, :, None]
    cos = torch.tensor([[0.9]])
    assert (math.pi * Principled(values)(cos, cos, torch.ones_like(cos), cos)).mean() == pytest.approx(1.0, abs=0.02)


def test_half_and_difference_vectors_are_unit_and_give_back_the_light():
    cos_l, _, cos_h, cos_d = directions()
    h, d = half_difference(cos_l, cos_h, cos_d)
    assert torch.allclose(sum(x.square() for x in h), torch.ones_like(cos_l), atol=1e-5)
    assert torch.allclose(sum(x.square() for x in d), torch.ones_like(cos_l), atol=1e-5)
    assert torch.allclose(h[2] * d[2] - h[0] * d[0], cos_l, atol=1e-4)  # n.l in Rusinkiewicz' frame


def write_merl(path, f):
    """A MERL file of the value f(theta_h index, theta_d index, phi_d index) before scaling."""
    i, j, k = np.ogrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]]
    with path.open("wb") as file:
        file.write(np.array(SHAPE, "<i4").tobytes())
        for channel in range(3):
            file.write((f(i, j, k, channel) + np.zeros(SHAPE)).astype("<f8").tobytes())


@pytest.fixture(scope="module")
def merl_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("merl") / "made.binary"
    write_merl(path, lambda i, j, k, c: np.where(j > 85, -1.0, 1500.0 * (1 + c) + i))
    return path


def test_merl_file_is_read_in_its_units_and_invalid_samples_filled(merl_file):
    table = read_merl(merl_file)
    assert table.shape == (*SHAPE, 3)
    assert table[0, 0, 0, 0] == pytest.approx(1.0)
    assert table[10, 0, 0, 1] == pytest.approx((3000 + 10) * 1.15 / 1500)
    assert table[5, 89, 7, 2] == pytest.approx((4500 + 5) * 1.66 / 1500)
    f = Merl(table[None])(*(x[:, None] for x in directions()))
    assert f.shape == (1, 1, 3, 64) and (f > 0).all()


def test_merl_file_of_the_wrong_size_is_refused(tmp_path):
    (tmp_path / "short.binary").write_bytes(b"\0" * 100)
    with pytest.raises(InputError, match="has 100 bytes but a MERL material has 34992012"):
        read_merl(tmp_path / "short.binary")


def test_no_materials_where_there_is_no_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("PHOTONORMAL_DATA", raising=False)
    assert data_folder() is None and library(None) is None
    with pytest.raises(InputError, match=r"holds no merl_sgd\.csv"):
        data_folder(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("merl_sgd.csv", "name,a\nteflon,1\n", "merl_sgd.csv has no or incomplete rows but 33 numbers"),
        ("merl_abc.csv", None, "merl_abc.csv can't be read as a table"),
        ("merl_abc.csv", "name\n", "merl_abc.csv has no or incomplete rows but 9 numbers"),
        ("merl_nbrdf.npz", None, "merl_nbrdf.npz can't be read as a table"),
        ("merl_nbrdf.npz", "no archive", "merl_nbrdf.npz can't be read as a table"),
    ],
)
def test_damaged_tables_of_materials_are_refused_in_one_line(tmp_path, name, content, message):
    for table, width in (("merl_sgd.csv", 33), ("merl_abc.csv", 9)):
        (tmp_path / table).write_text("name\nteflon" + ",0.5" * width + "\n")
    if content is None:
        (tmp_path / name).unlink(missing_ok=True)
    else:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        library(tmp_path)


@pytest.mark.data
def test_splits_share_no_name(data):
    train, validation, every = (library(data / "brdf", split) for split in ("train", "validation", "all"))
    assert not set(train.names) & set(validation.names)
    assert sorted(train.names + validation.names) == list(every.names)
    assert len(every.names) == 100 and len(validation.names) == -(-97 // HELD_OUT_EVERY)


@pytest.mark.data
@pytest.mark.parametrize("name", ["teflon", "beige-fabric", "yellow-matte-plastic"])
def test_the_three_fits_of_a_matt_material_agree(data, name):
    cos = torch.full((1, 1, 1), math.cos(math.radians(20)))
    h = torch.full_like(cos, math.cos(math.radians(10)))  # light at 20 degrees, view along the normal
    values = [
        named(data / "brdf", family, name)(cos, torch.ones_like(cos), h, h) for family in ("sgd", "abc", "neural")
    ]
    for f in values[1:]:
        assert torch.allclose(f.flatten(), values[0].flatten(), rtol=0.25, atol=0.02)


@pytest.mark.data
def test_unknown_material_is_refused(data):
    with pytest.raises(InputError, match="no sgd material 'gold-leaf'"):
        named(data / "brdf", "sgd", "gold-leaf")
