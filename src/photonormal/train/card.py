"""The card beside a weights file: what it learned from, how, and how well it does."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

import photonormal
from photonormal.disk import at_once
from photonormal.methods.learned.network import Model, parameters
from photonormal.methods.learned.weights import weights_file
from photonormal.resources import processor

LICENCE = "MIT"
TITLES = {  # kind of exam -> its heading
    "clean": "Rendered scenes, held-out materials",
    "hemisphere": "The same under lights from everywhere, noisy",
    "dark": "The first, with 20 to 255 grey levels",
    "hollow-metal": "Rendered pleats and bowls of metal",
    "blobby-paper": "Validation samples of the sets on disk, as the paper validates",
    "real": "Real objects, all images: mean angular error, degrees",
}


def export(out: Path, name: str, net: Model, trained: dict[str, Any]) -> Path:
    """Write `name`.safetensors (bf16) and `name`.md into `out`; returns the weights file."""
    data = weights_file(trained["network"], net, trained)
    with at_once(out) as batch:
        batch.write(f"{name}.safetensors", data)
        batch.write(f"{name}.md", card(name, net, trained, hashlib.sha256(data).hexdigest()).encode())
    return out / f"{name}.safetensors"


def card(name: str, net: Model, trained: dict[str, Any], digest: str) -> str:
    """The text of the card of a weights file."""
    rig = trained["recipe"].get("rig")
    rows = [
        ("network", f"{trained['network']}, {parameters(net):,} parameters: `{net.config}`"),
        ("learned from", learned_from(trained)),
        ("command", f"`{trained['command']}`"),
        ("began with", trained["began_with"]),
        ("seed", trained["recipe"]["seed"]),
        ("steps", f"{trained['steps']:,} of {trained['recipe']['batch'] * trained['recipe']['accumulate']} samples"),
        ("minutes", f"{trained['minutes']:.1f}"),
        ("device", trained["device"]),
        (
            "software",
            f"photonormal {photonormal.__version__}, torch {torch.__version__}, Python {platform.python_version()}",
        ),
        ("learned in", trained["precision"]),
        ("numbers", "bf16"),
        ("licence", LICENCE),
        ("sha256", digest),
    ]
    lines = [f"# {name}", "", "| | |", "|---|---|", *[f"| {k} | {v} |" for k, v in rows], ""]
    recipe = trained["recipe"] | ({"rig": f"{len(rig)} lights, which the weights name"} if rig else {})
    for kind, title in TITLES.items():
        if errors := trained["errors"].get(kind):
            lines += [f"## {title}", "", "| " + " | ".join(errors) + " |", "|" + "---|" * len(errors)]
            lines += ["| " + " | ".join(f"{v:.2f}" for v in errors.values()) + " |", ""]
    lines += ["## Recipe", "", "```json", json.dumps(recipe, indent=2), "```", ""]
    return "\n".join(lines)


def learned_from(trained: dict[str, Any]) -> str:
    """The scenes or the sets, in words."""
    if not trained["data"]:
        return f"scenes rendered by `photonormal.synth`, recipe `{trained['recipe']['stream']}`; no photographs"
    sets = (
        f"{s['name']} ({s['layout']}, {s['training']:,} samples, sha256 {s['sha256'][:12]})" for s in trained["data"]
    )
    return "sets on disk: " + ", ".join(sets)


def device_name(device: torch.device) -> str:
    """What the training ran on, in words."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"{processor()}, {torch.get_num_threads()} threads"


def command(
    recipe: str,
    out: Path,
    minutes: float | None,
    steps: int,
    world: int,
    seed: int,
    begun: str | Path | None,
    name: str,
    data: Sequence[str | Path] = (),
    lights: str | Path | None = None,
) -> str:
    """The command line that trains this again; RECIPE stands for one without a name, whose fields the card lists."""
    run = "photonormal" if world == 1 else f"torchrun --nproc-per-node {world} -m photonormal"
    words = [run, "train", recipe, "--out", str(out), f"--minutes {minutes:g}" if minutes else f"--steps {steps}"]
    words += [f"--data {folder}" for folder in data] + [f"--lights {lights}"] * (lights is not None)
    words += [f"--seed {seed}"] * bool(seed) + [f"--start-from {begun}"] * bool(begun)
    return " ".join(words + [f"--name {name}"] * (name != recipe))
