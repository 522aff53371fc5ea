"""Weights files: safetensors that carry the network's own description, each with a card that says what it learned from.

A file that is missing, damaged or made for another network is an error; there is never a network of random weights.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from photonormal.lookup import lookup
from photonormal.methods.learned.network import Model, placed
from photonormal.stored import Size, Vectors, Word, converted, decoded
from photonormal.types import InputError, by_name

NETWORKS = {  # name -> "module:Class", imported only when asked for
    "lambertian-prior": "photonormal.methods.learned.lambertian_prior:LambertianPriorNet",
    "psfcn": "photonormal.methods.learned.psfcn:PSFCNNet",
    "normalnet": "photonormal.methods.learned.normalnet:NormalNet",
    "cnn-ps": "photonormal.methods.learned.cnnps:CNNPSNet",
    "dpsn": "photonormal.methods.learned.dpsn:DPSNNet",
    "lmps": "photonormal.methods.learned.lmps:LMPSNet",
    "spline-net": "photonormal.methods.learned.splinenet:SPLINENet",
    "gps-net": "photonormal.methods.learned.gpsnet:GPSNet",
    "attention-psn": "photonormal.methods.learned.attentionpsn:AttentionPSNNet",
    "dr-psn": "photonormal.methods.learned.drpsn:DRPSNNet",
    "lightsnet": "photonormal.methods.learned.lightsnet:LightsNet",
}

SHIPPED = Path(__file__).parent / "weights"
LIGHTS = "sdps-lights"  # the weights there that find lights


def build(network: str, config: dict) -> Any:
    """A network by its name in NETWORKS and the fields of its config, freshly initialised."""
    cls = lookup(by_name("network", network, NETWORKS))
    known = {f.name for f in dataclasses.fields(cls.Config)}
    if unknown := sorted(set(config) - known):
        raise InputError(f"network {network} has no option {unknown[0]!r}; it has {', '.join(sorted(known))}.")
    return cls(converted(config, cls.Config, f"the configuration of a {network}", "correct it"))


def shipped(name: str) -> Path:
    """The weights file of a method that comes with the package."""
    return SHIPPED / f"{name}.safetensors"


def weights_file(network: str, net: Model, trained: dict, dtype: torch.dtype = torch.bfloat16) -> bytes:
    """A weights file: the weights with what is needed to build their network again.

    `trained` says how they were learned (recipe, seed, steps, ...), in values that JSON knows.
    """
    tensors = {k: v.detach().to("cpu", dtype).contiguous() for k, v in net.state_dict().items()}
    config = dataclasses.asdict(net.config)
    vectors = {k: v for k, v in config.items() if isinstance(v, tuple)}  # apart: each entry is read by one schema
    metadata = {
        "network": network,
        "config": json.dumps({k: v for k, v in config.items() if k not in vectors}),
        "vectors": json.dumps(vectors),
        "trained": json.dumps(trained),
        "sha256": fingerprint(tensors),
    }
    return save(tensors, metadata)


def load_network(path: Path, network: str | None = None, device: torch.device | str = "cpu") -> Any:
    """The network of a weights file, ready to measure.

    Raises
    ------
    InputError
        If the file is missing or not a weights file, its tensors are not those that were saved, the card beside it
        states another checksum, it is not of the kind `network`, or its tensors do not fit the network it describes.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"no weights {path}; reinstall photonormal or give a weights file.")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {k: file.get_tensor(k) for k in file.keys()}
    except (SafetensorError, OSError) as error:
        raise InputError(f"weights {path} can't be read ({error}); get the file again.") from None
    if not {"network", "config", "sha256"} <= set(metadata):
        raise InputError(f"{path} does not say which network it is for; give a file that photonormal train wrote.")
    if fingerprint(tensors) != metadata["sha256"] or stated_checksum(path) not in (None, checksum(path)):
        raise InputError(f"weights {path} are damaged: their checksum is not the one recorded; get the file again.")
    if network is not None and metadata["network"] != network:
        raise InputError(f"weights {path} are for {metadata['network']} but {network} is needed; give its own weights.")
    broken = f"weights {path}", "get the file again"
    config = decoded(metadata["config"], dict[str, bool | Size | Word], *broken)
    vectors = decoded(metadata.get("vectors", "{}"), dict[str, Vectors], *broken)
    try:
        with torch.device("meta"):  # nothing is allocated for what a file only claims
            net = build(metadata["network"], config | vectors)
        net.load_state_dict({k: v.float() for k, v in tensors.items()}, strict=True, assign=True)
    except InputError as error:
        raise InputError(f"weights {path} can't be used: {error}") from None
    except Exception as error:  # a network of senseless sizes fails in many ways
        reason = (str(error).strip() or type(error).__name__).splitlines()[-1].strip()
        raise InputError(f"weights {path} do not fit their network ({reason}); get the file again.") from None
    return placed(net, device).eval().requires_grad_(False)


def fingerprint(tensors: dict[str, torch.Tensor]) -> str:
    """SHA-256 over the names, shapes and bytes of tensors."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        tensor = tensors[name]
        digest.update(f"{name} {tuple(tensor.shape)} {tensor.dtype}".encode())
        digest.update(tensor.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    return digest.hexdigest()


def checksum(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def stated_checksum(path: Path) -> str | None:
    """The SHA-256 that the card beside a weights file states; None where there is no card."""
    card = path.with_suffix(".md")
    found = re.search(r"sha256\W+([0-9a-f]{64})\b", card.read_text(errors="replace")) if card.is_file() else None
    return found.group(1) if found else None
