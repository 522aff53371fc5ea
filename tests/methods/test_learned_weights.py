"""Weights files: what is saved comes back, and nothing else passes for it."""

import re

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from photonormal.methods.learned.lambertian_prior import LambertianPriorConfig, LambertianPriorNet
from photonormal.methods.learned.network import PixelNetwork
from photonormal.methods.learned.weights import NETWORKS, build, checksum, load_network, shipped, weights_file
from photonormal.train.recipes import ONE_RIG
from photonormal.types import InputError


@pytest.fixture
def file(tmp_path):
    torch.manual_seed(0)
    path = tmp_path / "tiny.safetensors"
    net = LambertianPriorNet(LambertianPriorConfig(width=8, concat=3))
    path.write_bytes(weights_file("lambertian-prior", net, {"recipe": "tiny"}, torch.float32))
    return path, net


def test_a_file_rebuilds_its_own_network(file):
    path, net = file
    again = load_network(path)
    assert again.config == net.config
    for k, v in net.state_dict().items():
        torch.testing.assert_close(again.state_dict()[k], v, atol=0, rtol=0)
    assert not again.training


def test_bf16_halves_the_file_and_keeps_the_weights(file, tmp_path):
    path, net = file
    half = tmp_path / "half.safetensors"
    half.write_bytes(weights_file("lambertian-prior", net, {}))
    assert half.stat().st_size < 0.75 * path.stat().st_size
    for k, v in net.state_dict().items():
        torch.testing.assert_close(load_network(half).state_dict()[k], v, atol=1e-6, rtol=2**-8)


def test_missing(tmp_path):
    with pytest.raises(InputError, match=r"no weights .*none\.safetensors"):
        load_network(tmp_path / "none.safetensors")


def test_damaged(file):
    path, _ = file
    data = bytearray(path.read_bytes())
    data[-7] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        load_network(path)
    path.write_bytes(data[:40])
    with pytest.raises(InputError, match="can't be read"):
        load_network(path)


def test_a_card_with_another_checksum(file):
    path, _ = file
    path.with_suffix(".md").write_text(f"sha256: {checksum(path)}\n")
    load_network(path)
    path.with_suffix(".md").write_text(f"sha256: {'0' * 64}\n")
    with pytest.raises(InputError, match="damaged"):
        load_network(path)


def test_of_another_network_or_none(file, tmp_path):
    path, _ = file
    with pytest.raises(InputError, match="are for lambertian-prior but psfcn is needed"):
        load_network(path, "psfcn")
    other = tmp_path / "other.safetensors"
    save_file({"a": torch.zeros(3)}, other)
    with pytest.raises(InputError, match="does not say which network"):
        load_network(other)


def test_tensors_that_do_not_fit(file, tmp_path):
    path, _ = file
    from safetensors import safe_open

    from photonormal.methods.learned.weights import fingerprint

    with safe_open(path, framework="pt") as f:
        metadata = f.metadata()
    tensors = load_file(path)
    tensors.pop("regressor.last.1.weight")
    metadata["sha256"] = fingerprint(tensors)
    save_file(tensors, path, metadata=metadata)
    with pytest.raises(InputError, match="do not fit"):
        load_network(path)


def test_unknown_networks_and_options():
    with pytest.raises(InputError, match="no network 'vgg'"):
        build("vgg", {})
    with pytest.raises(InputError, match="no option 'widht'"):
        build("psfcn", {"widht": 3})


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_builds(name):
    config = {"lights": ((0.0, 0.0, 1.0),) * 3} if name in ONE_RIG else {}
    net = build(name, config)
    assert net.Config(**config) == net.config
    assert net.scaling in ("exposure", "channels", "grey")
    assert net.learns == "lights" or (net.stride > 0 and (net.reach > 0 or isinstance(net, PixelNetwork)))


def test_shipped_weights_are_complete():
    for card in shipped("x").parent.glob("*.md"):
        load_network(card.with_suffix(".safetensors"))


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ("{", "can't be read"),
        ("[" * 100_000, "can't be read"),
        ('{"width": 100000}', "<= 4096"),
        ('{"width": "8"}', "Expected `int`, got `str`"),
        ('{"width": -8}', ">= 0"),
        ('{"width": 4096}', "do not fit their network"),
        ('{"width": 0}', "tiny.safetensors can't be used"),
        ('{"prior": 1}', "Expected `str`"),
    ],
)
def test_a_network_that_is_only_claimed_is_never_made(file, config, says):
    path, _ = file
    with safe_open(path, framework="pt") as opened:
        metadata = opened.metadata() | {"config": config}
    save_file(load_file(path), path, metadata=metadata)
    with pytest.raises(InputError, match=re.escape(says)) as told:
        load_network(path)
    assert len(str(told.value).splitlines()) == 1
