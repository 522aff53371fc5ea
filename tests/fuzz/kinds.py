"""Small sound captures of every kind that is read, each with the command that reads it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.capture.files import write_picture

SHAPE = (12, 10)
LIGHTS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8], [-0.48, 0.36, 0.8]])
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


def tga(folder: Path) -> list[str]:
    command = plain(folder, ".png", np.uint8)
    for j in range(4):
        (folder / f"{j + 1}.png").unlink()
        start = struct.pack("<3x9xHHBB", SHAPE[1], SHAPE[0], 24, 0x20)
        (folder / f"{j + 1}.tga").write_bytes(b"\0\0\2" + start[3:] + picture(j)[..., ::-1].tobytes())
    return command


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
    "luces": luces,
    "mat": truth,
    "corrections": corrections,
    "camera": camera,
    "options": options,
    "near": near,
    "tga": tga,
    "stack": stack,
    "project": project,
    "channels": channels,
    **{f"lights {n}": lambda folder, n=n: lights(folder, n) for n in ("l.npy", "l.mat", "l.json", "l.dome")},
    **{f"lens {n}": lambda folder, n=n: lens(folder, n) for n in (*LENS, "lens.npz")},
    **{f"normals {s}": lambda folder, s=s: normals(folder, s) for s in (".npz", ".exr", ".png")},
}
