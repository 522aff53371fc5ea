"""Changes to one file: to its bytes, to the values in it, or to what it is."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

HOSTILE = (
    *(None, True, -1, 0, 10**18, 1e308, float("nan"), "", "x" * 5000, "\x1b[31m red"),
    *("../../../etc/passwd", "line\nline"),
    *("<img src=x onerror=alert(1)>", "\ud800", [], {}, [[]], {"__proto__": {"a": 1}}, {"": None}),
)  # fmt: skip
DEEP = 100_000


def changed(path: Path, draw: random.Random) -> str:
    """Change a file in place; says how."""
    by_ending = {".json": json_values, ".npz": arrays, ".safetensors": header, ".pt": checkpoint, ".jsonl": json_lines}
    ways = [bytes_changed, bytes_changed, other_kind, by_ending.get(path.suffix, text)]
    ways += [by_ending.get(path.suffix, text)] * 3
    way = draw.choice(ways)
    return f"{way.__name__}: {way(path, draw)}"


def bytes_changed(path: Path, draw: random.Random) -> str:
    """Cut, flipped, inserted or emptied."""
    data = bytearray(path.read_bytes())
    how = draw.choice(("cut", "flipped", "inserted", "emptied", "zeroed", "doubled"))
    at = draw.randrange(len(data) + 1)
    if how == "cut":
        del data[at:]
    elif how == "flipped":
        for _ in range(draw.choice((1, 8, 64))):
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif how == "inserted":
        data[at:at] = draw.randbytes(draw.choice((1, 100, 10_000)))
    elif how == "emptied":
        data.clear()
    elif how == "zeroed":
        data[at : at + 1000] = bytes(min(1000, len(data) - at))
    else:
        data += bytes(data)
    path.write_bytes(bytes(data))
    return how


def other_kind(path: Path, draw: random.Random) -> str:
    """No file any more."""
    path.unlink()
    how = draw.choice(("absent", "folder", "fifo", "loop", "device"))
    if how == "folder":
        path.mkdir()
    elif how == "fifo":
        os.mkfifo(path)
    elif how in ("loop", "device"):
        path.symlink_to(path if how == "loop" else "/dev/zero")
    return how


def json_values(path: Path, draw: random.Random) -> str:
    """One value replaced, left out or nested deep."""
    text, how = json_text(path.read_text(), draw)
    path.write_bytes(text)
    return how


def json_lines(path: Path, draw: random.Random) -> str:
    """The same in one line of many."""
    lines = path.read_bytes().splitlines()
    i = draw.randrange(len(lines))
    lines[i], how = json_text(lines[i].decode(), draw)
    path.write_bytes(b"\n".join(lines))
    return how


def json_text(text: str, draw: random.Random) -> tuple[bytes, str]:
    """A JSON text with something in it changed, and how."""
    if draw.random() < 0.15:
        opening = draw.choice(("[", '{"a":'))
        return (opening * DEEP + draw.choice(("", "]" * DEEP))).encode(), "deep"
    value = json.loads(text)
    how = replaced(value, draw)
    return json.dumps(value).encode(), how


def replaced(value: Any, draw: random.Random) -> str:
    """Replace something in nested lists and dictionaries."""
    at = [value]
    while isinstance(at[-1], dict | list) and at[-1] and (len(at) == 1 or draw.random() < 0.7):
        holder = at[-1]
        key = draw.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
        at.append(holder[key])
        place = holder, key
    holder, key = place
    if draw.random() < 0.2:
        del holder[key]
        return f"without {key}"
    holder[key] = draw.choice(HOSTILE)
    return f"{key} is {str(holder[key])[:30]!r}"


def arrays(path: Path, draw: random.Random) -> str:
    """One array of another type or size, or that claims or unpacks to far more than there is."""
    with np.load(path) as file:
        data = dict(file)
    name = draw.choice(list(data))
    how = draw.choice(("absent", "flat", "empty", "nan", "text", "complex", "other size", "bomb", "claims", "negative"))
    if how in ("bomb", "claims", "negative"):
        shape = {"bomb": (20_000, 20_000, 3), "claims": (10**9, 10**9, 3), "negative": (-1, 4, 3)}[how]
        buffer = io.BytesIO()
        np.lib.format.write_array_header_1_0(buffer, {"descr": "<f4", "fortran_order": False, "shape": shape})
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(f"{name}.npy", "w") as member:
            member.write(buffer.getvalue())
            for _ in range(32 if how == "bomb" else 1):
                member.write(bytes(2**20))
        return how
    array = data.pop(name)
    values = {
        "flat": array.ravel(),
        "empty": array[:0],
        "nan": np.full(array.shape, np.nan, np.float32),
        "text": np.full(array.shape, "x"),
        "complex": array.astype(complex),
        "other size": array[1:],
    }
    if how in values:
        data[name] = values[how]
    np.savez(path, **data)
    return f"{name} {how}"


def header(path: Path, draw: random.Random) -> str:
    """The JSON of a safetensors file, or that in its metadata."""
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    value = json.loads(data[8 : 8 + length])
    inner = draw.choice(("", "config", "trained"))
    if inner:
        text, how = json_text(value["__metadata__"][inner], draw)
        value["__metadata__"][inner] = text.decode()
    else:
        how = replaced(value, draw)
    text = json.dumps(value).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + data[8 + length :])
    path.with_suffix(".md").unlink()  # the card states another checksum
    return f"{inner} {how}"


def checkpoint(path: Path, draw: random.Random) -> str:
    """One value of a training's state."""
    import torch

    state = torch.load(path, weights_only=True)
    how = replaced(state, draw)
    torch.save(state, path)
    return how


def text(path: Path, draw: random.Random) -> str:
    """One line replaced."""
    lines = path.read_text().splitlines()
    line = draw.choice(
        ("", "secret", "ball: secret", "1-99999999", "9" * 5000, "\x1b[31m", "1-", ":", "-1", "0", "1,1,1", "5-1")
    )
    lines[draw.randrange(len(lines))] = line
    path.write_text("\n".join(lines))
    return line[:30]
