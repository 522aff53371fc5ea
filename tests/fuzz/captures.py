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
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.capture.files import write_picture
from tests.fuzz.bombs import BOMBS
from tests.fuzz.drive import Driver, campaign

SHAPE = (12, 10)
LIGHTS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.48, 0.36, 0.8]])
EXTREMES = ("nan", "inf", "-1", "0", "1e308", "1e-320", "9" * 400, "99999999", "", "0x1f", "1,5", "\x1b[31m", "é")
SIZES = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**31, 2**16 + 1)
LENS = {
    "lens.yml": """%YAML:1.0
---
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 30., 0., 5., 0., 30., 6., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0., 0., 0., 0. ]
""",
    "lens.json": """{"camera_matrix": {"rows": 3, "cols": 3, "data": [30, 0, 5, 0, 30, 6, 0, 0, 1]},
"dist": [0.1, 0, 0, 0, 0]}""",
    "lens.xml": """<?xml version="1.0"?><opencv_storage>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>30. 0. 5. 0. 30. 6. 0. 0. 1.</data></camera_matrix>
<D><rows>1</rows><cols>4</cols><data>0 0 0 0</data></D></opencv_storage>""",
}


def picture(j: int, dtype: type = np.uint8, channels: int = 3) -> np.ndarray:
    """A lit ball with grain."""
    rng = np.random.default_rng(j)
    level = (40 + 60 * LIGHTS[j % 4, 2] + rng.random((*SHAPE, channels)) * 50) / 255
    return level.astype(dtype) if np.dtype(dtype).kind == "f" else (level * np.iinfo(dtype).max).astype(dtype)


def plain(folder: Path, suffix: str, dtype: type, channels: int = 3, **options: object) -> list[str]:
    for j in range(4):
        write_picture(folder / f"{j + 1}{suffix}", picture(j, dtype, channels), **options)
    np.savetxt(folder / "light_directions.txt", LIGHTS, fmt="%.3f")
    write_picture(folder / "mask.png", np.full((*SHAPE, 1), 255, np.uint8))
    return ["measure", "."]


def with_exif(folder: Path) -> list[str]:
    command = plain(folder, ".jpg", np.uint8)
    tiff = struct.pack("<2sHI", b"II", 42, 8) + struct.pack("<HHHIII", 1, 0x8769, 4, 1, 26, 0)
    tiff += struct.pack("<HHHIIHHIII", 2, 0x829A, 5, 1, 56, 0x8827, 3, 1, 100, 0) + struct.pack("<II", 1, 50)
    block = b"Exif\0\0" + tiff
    for j in range(4):
        file = folder / f"{j + 1}.jpg"
        data = file.read_bytes()
        file.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:])
    return [*command, "--exif-exposure"]


def listed(folder: Path) -> list[str]:
    command = plain(folder, ".png", np.uint16)
    (folder / "filenames.txt").write_text("1.png\n2.png\n3.png\n4.png\n")
    np.savetxt(folder / "light_intensities.txt", np.ones((4, 3)), fmt="%.3f")
    return command


def lp(folder: Path) -> list[str]:
    command = plain(folder, ".png", np.uint8)
    (folder / "light_directions.txt").unlink()
    lines = [f"{j + 1}.png {x:.3f} {y:.3f} {z:.3f}" for j, (x, y, z) in enumerate(LIGHTS)]
    (folder / "rig.lp").write_text("\n".join(["4", *lines]))
    return command


def csv(folder: Path) -> list[str]:
    command = plain(folder, ".bmp", np.uint8)
    (folder / "light_directions.txt").unlink()
    (folder / "lights.csv").write_text("\n".join(f"{j + 1}.bmp;{x};{y};{z}" for j, (x, y, z) in enumerate(LIGHTS)))
    return command


def lights(folder: Path, name: str) -> list[str]:
    """Lights in another form, in the folder or named."""
    from scipy.io import savemat

    command = plain(folder, ".png", np.uint8)
    (folder / "light_directions.txt").unlink()
    if name.endswith(".npy"):
        np.save(folder / name, LIGHTS)
    elif name.endswith(".mat"):
        savemat(folder / name, {"S": LIGHTS, "mu": np.ones((4, 1))}, do_compression=True)
    elif name.endswith(".json"):
        rows = ", ".join(f'{{"direction": {l}, "intensity": [1, 1, 1]}}' for l in LIGHTS.tolist())
        (folder / name).write_text(f'{{"lights": [{rows}]}}')
    else:
        (folder / name).write_text(f'{{"imageWidth": 210.0, "domeDiameter": 600, "directions": {LIGHTS.tolist()}}}')
    return [*command, "--lights", name]


def project(folder: Path) -> list[str]:
    for j in range(4):
        write_picture(folder / "jpeg-exports" / f"{j + 1}.jpg", picture(j))
    (folder / "assembly-files").mkdir()
    lines = [f"C:\\owl\\jpeg-exports\\{j + 1}.jpg {x:.3f} {y:.3f} {z:.3f}" for j, (x, y, z) in enumerate(LIGHTS)]
    (folder / "assembly-files" / "owl.lp").write_text("\n".join(["4", *lines]))
    return ["measure", "."]


def stack(folder: Path) -> list[str]:
    import tifffile

    tifffile.imwrite(folder / "owl.tif", np.stack([picture(j, np.uint16)[..., 0] for j in range(4)]), imagej=True)
    np.savetxt(folder / "light_directions.txt", LIGHTS, fmt="%.3f")
    return ["measure", "."]


def channels(folder: Path) -> list[str]:
    write_picture(folder / "gel.png", picture(0))
    np.savetxt(folder / "light_directions.txt", LIGHTS[1:], fmt="%.3f")
    return ["measure", ".", "--rgb-lights"]


def luces(folder: Path) -> list[str]:
    for j in range(4):
        write_picture(folder / f"{j + 1:02d}.png", picture(j, np.uint16))
    rows = [f"{100 * x:.1f} {100 * y:.1f} 10 0 0 1 1 1 1 0.5" for x, y, _ in LIGHTS]
    (folder / "led_params.txt").write_text("names\n4 12 10 300 5 6 200\n" + "\n".join(rows))
    return ["measure", "."]


def truth(folder: Path) -> list[str]:
    from scipy.io import savemat

    command = plain(folder, ".png", np.uint8)
    savemat(folder / "Normal_gt.mat", {"Normal_gt": np.tile([0.0, 0, 1], (*SHAPE, 1))}, do_compression=True)
    return command


def corrections(folder: Path) -> list[str]:
    command = plain(folder, ".png", np.uint16)
    write_picture(folder / "dark" / "a.png", np.full((*SHAPE, 3), 20, np.uint16))
    write_picture(folder / "dark" / "b.tif", np.full((*SHAPE, 3), 60000, np.uint16))
    return [*command, "--dark", "dark/a.png", "--flat", "dark/b.tif", "--hot-pixels"]


def lens(folder: Path, name: str) -> list[str]:
    command = plain(folder, ".png", np.uint8)
    if name == "lens.npz":
        np.savez(folder / name, K=np.diag([30.0, 30, 1]), D=np.zeros(5))
    else:
        (folder / name).write_text(LENS[name])
    return [*command, "--lens", name]


def camera(folder: Path) -> list[str]:
    command = plain(folder, ".png", np.uint8)
    np.savetxt(folder / "K.txt", [[30, 0, 5], [0, 30, 6], [0, 0, 1]], fmt="%.2f")
    return [*command, "--camera", "K.txt"]


def options(folder: Path) -> list[str]:
    """Files that options name, in place of the capture's own."""
    command = plain(folder, ".png", np.uint8)
    np.savetxt(folder / "other.txt", LIGHTS, fmt="%.3f")
    np.savetxt(folder / "levels.txt", np.ones((4, 3)), fmt="%.3f")
    write_picture(folder / "given" / "mask.png", np.full((*SHAPE, 1), 255, np.uint8))
    return [*command, "--lights", "other.txt", "--intensities", "levels.txt", "--mask", "given/mask.png"]


def near(folder: Path) -> list[str]:
    """Lamps near the object, at positions in mm."""
    command = plain(folder, ".png", np.uint8)
    np.savetxt(folder / "light_positions.txt", 300 * LIGHTS, fmt="%.1f")
    return [*command, "--mm-per-px", "0.5", "--lights", "light_positions.txt"]


def normals(folder: Path, suffix: str) -> list[str]:
    map = np.tile([0.0, 0, 1], (*SHAPE, 1)).astype(np.float32)
    if suffix == ".npz":
        np.savez_compressed(folder / "n.npz", normals=map, mask=np.ones(SHAPE, bool))
    elif suffix == ".exr":
        write_picture(folder / "n.exr", map)
    else:
        write_picture(folder / "n.png", ((map + 1) * 32767.5).astype(np.uint16))
    return ["integrate", f"n{suffix}"]


KINDS: dict[str, Callable[[Path], list[str]]] = {
    "png": lambda folder: plain(folder, ".png", np.uint8),
    "png16": lambda folder: plain(folder, ".png", np.uint16, 1),
    "jpeg": lambda folder: plain(folder, ".jpg", np.uint8),
    "tiff": lambda folder: plain(folder, ".tif", np.uint16),
    "tiff packed": lambda folder: plain(folder, ".tif", np.uint16, compression="zlib"),
    "exr": lambda folder: plain(folder, ".exr", np.float32),
    "npy": lambda folder: plain(folder, ".npy", np.float32, 1),
    "exif": with_exif,
    "list": listed,
    "lp": lp,
    "csv": csv,
    **{f"lights {n}": lambda folder, n=n: lights(folder, n) for n in ("l.npy", "l.mat", "l.json", "l.dome")},
    "project": project,
    "stack": stack,
    "channels": channels,
    "luces": luces,
    "mat": truth,
    "corrections": corrections,
    "camera": camera,
    "options": options,
    "near": near,
    **{f"lens {n}": lambda folder, n=n: lens(folder, n) for n in (*LENS, "lens.npz")},
    **{f"normals {s}": lambda folder, s=s: normals(folder, s) for s in (".npz", ".exr", ".png")},
}


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
