"""How much is held at a time, by the memory that is allowed (`--memory`); what is found does not depend on it."""

from __future__ import annotations

import torch

from photonormal.files import memory
from photonormal.methods.learned.network import Network, PixelNetwork
from photonormal.types import Capture, MachineLimit

LEVELS = 2**26  # grey levels held at a time, at most
LEVEL = 64  # bytes allowed for each, with what is made of them
RESULTS = 36  # bytes of each pixel of the frame: normals, expected errors, depth, albedo, masks
LITTLE = 8  # this part of the memory is worked in where these leave less
SIDE = {"cpu": 2048, "cuda": 1024}  # of a window in pixels, without its margins, at most
LEAST = 64  # pixels of a window's side, at least
WINDOW = 2 / 3  # of the memory, at most
SEEN = 3328  # bytes that a network holds for each pixel that it looks at, in each quarter turn
LIGHT = 36  # bytes of each light of such a pixel, where they differ from pixel to pixel
SAMPLE = 8  # bytes of each sample of such a pixel, where a network is shown all at once
KEPT = 896  # bytes of each pixel of the rows that a network sees by their pixels and then looks around in, each turn
BAND = 2368  # bytes of each pixel of such rows while they are read
LOADED = 420 * 10**6  # bytes of Python and its libraries, and what a first look leaves behind
FOUND = 40  # bytes of each pixel of the box, for what is found of it: it lies beside the windows
ASIDE = 8  # on disk where it would take more than this part of the memory
MASKS = 8  # bytes of each pixel that are left then
BLOCK = 2**17  # pixels of such rows that are looked at together, about
ROWS = 128  # such rows, about, where a picture is wide
TILE = 3 * 2**14  # pixels looked at together there, by each core, at most
COLUMNS = 512  # of them, at most: a window that shows some of them makes them all
TILES = 1 / 6  # of the memory, for these
SLACK = 1.1  # memory taken over what is held: pieces that were freed lie between those that are not
MOST = 512  # such rows that are read together


def levels(capture: Capture) -> int:
    """Grey levels that may be held at a time, beside libraries, pictures and the results of the frame."""
    beside = LOADED + memory.held() + RESULTS * capture.mask.size
    return min(LEVELS, max(memory.allowed() - beside, memory.allowed() // LITTLE) // LEVEL)


def pixels(capture: Capture) -> int:
    """Pixels of a capture whose grey levels may be held at a time; InputError where they are not one row."""
    n, _, width, _ = capture.images.shape
    _refuse(n * width * LEVEL, f"a row of {width} pixels in {n} photographs")
    return max(width, levels(capture) // n)


def tile(
    net: Network,
    passes: int,
    rotations: int,
    device: torch.device,
    box: tuple[int, ...],
    n: int,
    side: int = 0,
    near: bool = False,
) -> tuple[tuple[int, int], int]:
    """Size of a window (h, w) without its margins, and its rows that are looked at together; InputError if none fits.

    All are multiples of the network's stride. On a processor they are what the memory allows; other devices have their
    own. A network that sees pixels by themselves has windows as high as the box, as wide if it can. `side`: of a window
    and of such rows, in place of what fits. `near`: each pixel has lights of its own.
    """
    beside = memory.held() + LOADED + (MASKS if lies_aside(box, device) else FOUND) * box[0] * box[1]
    if isinstance(net, PixelNetwork):
        wide, band = (side, block(box, net.stride)) if side else _band(net, passes, rotations, device, box, n, beside)
        return (box[0], _down(wide, net.stride)), band
    most, margin = SIDE.get(device.type, SIDE["cuda"]), 2 * passes * net.reach
    each, free = rotations * SEEN + near * n * LIGHT, int(min(WINDOW * memory.allowed(), memory.allowed() - beside))
    if not side and device.type == "cpu" and each * box[0] * box[1] > free:
        least = min((LEAST + margin) ** 2, box[0] * box[1])
        _refuse(
            int(max(beside + each * least, each * least / WINDOW)),
            f"a window of {LEAST} pixels with {margin // 2} around it",
        )
        most = min(most, int((free / each) ** 0.5) - margin)
    most = _down(side or most, net.stride)
    return (most, most), most


def _band(
    net: PixelNetwork, passes: int, rotations: int, device: torch.device, box: tuple[int, ...], n: int, beside: int
) -> tuple[int, int]:
    """Width of a window without its margins, and its rows that are looked at together."""
    h, w = box
    around = net.reach + 2 * net.stride
    kept, read = KEPT * rotations, BAND * rotations + SAMPLE * n  # bytes of a pixel, in each pass and while it is read
    tiles = at_once() * SEEN * min(TILE, h * w)

    def needed(wide: int, rows: int) -> int:
        seen = [min(w, wide + 2 * k * net.reach) for k in range(1, passes + 1)]  # the last pass first
        return int(beside + SLACK * (tiles + sum(seen) * kept * min(rows + around, h) + seen[-1] * read * rows))

    rows = block(box, net.stride)
    if device.type != "cpu":
        return w, rows * max(1, SIDE["cuda"] ** 2 // w // rows)
    least = max(net.stride, _down(min(rows, ROWS) // 2, net.stride))
    widths = (-(-w // windows) for windows in range(1, max(1, w // LEAST) + 1))
    wide = next((wide for wide in widths if needed(wide, least) <= memory.allowed()), min(w, LEAST))
    _refuse(
        needed(wide, least),
        f"a band of {least} rows of {wide} pixels with {passes * net.reach} around it, beside libraries and pictures,",
    )
    bands = [k * rows for k in range(max(1, min(MOST, h) // rows), 0, -1)]
    return wide, next((band for band in bands if needed(wide, band) <= memory.allowed()), least)


def lies_aside(box: tuple[int, ...], device: torch.device) -> bool:
    """Whether what is found of a box (h, w) lies on disk while windows are looked at."""
    return device.type == "cpu" and FOUND * box[0] * box[1] * ASIDE > memory.allowed()


def block(box: tuple[int, ...], stride: int) -> int:
    """Rows of a box (h, w) that are looked at together, so many at a time: a multiple of a stride."""
    rows = max(ROWS, BLOCK // box[1])
    return -(-box[0] // max(1, round(box[0] / rows)) // stride) * stride


def tiles(width: int, rows: int, reach: int, stride: int) -> list[slice]:
    """Columns that are looked at together, with `reach` around them, of so many rows; multiples of a stride."""
    wide = max(stride, _down(min(COLUMNS, TILE // max(1, rows) - 2 * reach), stride))
    return [slice(x, min(x + wide, width)) for x in range(0, width, wide)]


def at_once() -> int:
    """How many of these the memory holds."""
    return max(1, int(memory.allowed() * TILES / SEEN / TILE))


def _down(pixels: int, stride: int) -> int:
    return pixels // stride * stride


def _refuse(needed: int, what: str) -> None:
    if needed > memory.allowed():
        raise MachineLimit(
            f"{what} needs {memory.text_of(needed)} but {memory.text_of(memory.allowed())} of memory is allowed; allow "
            f"more, such as --memory {memory.text_of(needed, '')}."
        )
