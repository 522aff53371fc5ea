"""Malformed captures: small whole ones of every kind that is read, each with something wrong by a seeded generator.

    python -m tests.fuzz.captures [--cases 10000] [--seed 0]

prints each case that misbehaves, and how many did.
"""

from __future__ import annotations

import os
import re
import shutil
import struct
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np

from tests.fuzz.bombs import BOMBS
from tests.fuzz.drive import Driver, campaign
from tests.fuzz.kinds import KINDS

EXTREMES = ("nan", "inf", "-1", "0", "1e308", "1e-320", "9" * 400, "99999999", "", "0x1f", "1,5", "\x1b[31m", "é")
SIZES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**31, 2**16 + 1)


def damage(data: bytes, rng: np.random.Generator) -> bytes:
    """The bytes of a file with a few of them wrong; a PNG's checksums are made right again now and then."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(out))) if out else 0
        match rng.integers(9):
            case 0:
                del out[at:]
            case 1:
                out[at:at] = rng.bytes(int(rng.integers(1, 60)))
            case 2:
                out[at : at + 4] = struct.pack(rng.choice(["<I", ">I"]), rng.choice(SIZES) & 0xFFFFFFFF)
            case 3:
                out[at : at + 2] = struct.pack(rng.choice(["<H", ">H"]), rng.choice(SIZES) & 0xFFFF)
            case 4:
                end = at + int(rng.integers(1, 200))
                out[at:at] = out[at:end] * int(rng.integers(1, 50))
            case 5:
                del out[at : at + int(rng.integers(1, 40))]
            case 6 if out:
                early = int(rng.integers(min(len(out), 80)))
                out[early] = int(rng.integers(256))
            case 7:
                numbers = list(re.finditer(rb"[-0-9.]+", out))
                if numbers:
                    start, end = numbers[rng.integers(len(numbers))].span()
                    out[start:end] = str(rng.choice(EXTREMES)).encode("latin-1")
            case _ if out:
                out[at] ^= 1 << int(rng.integers(8))
    return checked(bytes(out)) if rng.random() < 0.7 else bytes(out)


def checked(data: bytes) -> bytes:
    """A PNG with the checksums that its chunks ought to have; anything else as it is."""
    out, at = bytearray(data), 8
    if not data.startswith(b"\x89PNG"):
        return data
    while at + 12 <= len(out):
        end = at + 8 + int.from_bytes(out[at : at + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = struct.pack(">I", zlib.crc32(out[at + 4 : end]))
        at = end + 4
    return bytes(out)


def misuse(folder: Path, file: Path, rng: np.random.Generator) -> None:
    """Something else in a file's place: nothing, a folder, a FIFO, a link, a device, another file, another name."""
    others = [p for p in folder.rglob("*") if p.is_file() and p != file]
    held = file.read_bytes()
    file.unlink()
    match rng.integers(9):
        case 0:
            file.mkdir()
        case 1:
            os.mkfifo(file)
        case 2:
            file.symlink_to(file.name)
        case 3:
            file.symlink_to("/dev/zero")
        case 4:
            file.symlink_to("/etc/shadow")
        case 5 if others:
            shutil.copy(others[rng.integers(len(others))], file)
        case 6:
            names = ("\x1b[31m red", "é" * 100, "a" * 240, "line\nbreak", os.fsdecode(b"\xe9t\xe9"), "<img onerror>")
            (folder / (str(names[rng.integers(len(names))]) + file.suffix)).write_bytes(held)
        case 7:
            file.write_bytes(b"")
        case _:
            pass


def write(folder: Path, seed: int) -> tuple[str, list[str]]:
    """Write the malformed capture of a seed; its kind and the command that reads it."""
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    command = KINDS[kind](folder)
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    for _ in range(rng.integers(1, 3)):
        file = files[rng.integers(len(files))]
        if not file.is_file() or file.is_symlink():
            continue
        if rng.random() < 0.15:
            misuse(folder, file, rng)
        elif file.suffix in BOMBS and rng.random() < 0.05:
            BOMBS[file.suffix](file)
        else:
            file.write_bytes(damage(file.read_bytes(), rng))
    return kind, command


def with_out(command: list[str], place: Path) -> list[str]:
    """The command with what it writes lying in `place`."""
    out = ["out", "--method", "woodham"] if command[0] == "measure" else ["out.ply"]
    return [*command, "--out", str(place / out[0]), *out[1:]]


def faults(driver: Driver, seed: int) -> list[str]:
    """What goes wrong with the capture of a seed."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        (place / "capture").mkdir()
        kind, command = write(place / "capture", seed)
        found = driver.faults(place / "capture", *with_out(command, place))
        left = {p.name for p in place.iterdir()} - {"capture", "out", "out.ply"}
        return [f"{seed} {kind}: {f}" for f in found + [f"left {name!r}" for name in sorted(left)]]


if __name__ == "__main__":
    sys.exit(campaign("malformed captures", 10_000, faults, Driver()))
