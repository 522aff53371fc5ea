"""Files are opened here, and nowhere else: regular ones only, and read no further than their kind needs."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import IO, Any, BinaryIO, NamedTuple
from zipfile import ZipFile

import numpy as np

from photonormal.files import memory
from photonormal.types import InputError

TEXT = 4 * 2**20  # bytes of a list of lights or of intensities, at most
FLAGS = ("O_NONBLOCK", "O_CLOEXEC", "O_NOCTTY", "O_BINARY")  # those that the system has; a FIFO must not block
OTHERS = {stat.S_IFIFO: "a FIFO", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


class Stamp(NamedTuple):
    """What differs, mostly, when a file is no longer what it was before."""

    bytes: int
    mtime_ns: int

    @classmethod
    def of(cls, status: os.stat_result) -> Stamp:
        """That of a file of this status."""
        return cls(status.st_size, status.st_mtime_ns)


class Opened(NamedTuple):
    """A file that was opened: what it was then, and the SHA-256 of its content where all of it was read."""

    stamp: Stamp
    sha256: str = ""


_noted: list[dict[Path, Opened]] = []


@contextmanager
def noted() -> Iterator[dict[Path, Opened]]:
    """Every file that is opened while the block lasts, by any thread, and what it was then."""
    opened: dict[Path, Opened] = {}
    _noted.append(opened)
    try:
        yield opened
    finally:
        _noted.remove(opened)


class _Noted(io.FileIO):
    """An open file that is noted, and digested while it is read from its beginning to its end."""

    def __init__(self, descriptor: int, path: Path) -> None:
        super().__init__(descriptor, "rb")
        self._path, self._stamp = path.resolve(), Stamp.of(os.fstat(descriptor))
        self._passed, self._digest = 0, hashlib.sha256()  # bytes that it has seen
        for opened in _noted:
            opened.setdefault(self._path, Opened(self._stamp))
        self._wanted = not all(opened[self._path].sha256 for opened in _noted)

    def readinto(self, buffer: Any, /) -> int | None:
        at, count = self.tell(), super().readinto(buffer)
        self._pass(at, memoryview(buffer).cast("B")[:count])
        return count

    def readall(self) -> bytes:
        at, data = self.tell(), super().readall()
        self._pass(at, memoryview(data))
        return data

    def _pass(self, at: int, data: memoryview) -> None:
        if not self._wanted or at != self._passed:
            return
        self._digest.update(data)
        self._passed += len(data)
        if self._passed == self._stamp.bytes:
            self._wanted = False
            for opened in _noted:
                if opened.get(self._path, Opened(self._stamp)).stamp == self._stamp:
                    opened[self._path] = Opened(self._stamp, self._digest.hexdigest())


def open_file(path: Path) -> BinaryIO:
    """A regular file, open for reading.

    Raises
    ------
    InputError
        If it is a FIFO, a device or a socket, or the name can be no file's.
    OSError
        If there is none, it is a folder, or it may not be read.
    """
    flags = os.O_RDONLY
    for name in FLAGS:
        flags |= getattr(os, name, 0)
    try:
        descriptor = os.open(path, flags)
    except ValueError:
        raise InputError(f"{path} can be no file's name but a file is needed; correct it.") from None
    kind = stat.S_IFMT(os.fstat(descriptor).st_mode)
    if kind == stat.S_IFREG:
        return io.BufferedReader(_Noted(descriptor, Path(path))) if _noted else os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise InputError(f"{path} is {OTHERS.get(kind, 'no regular file')} but a regular file is needed; give one.")


def size_of(file: IO[bytes]) -> int:
    """Bytes of an open file."""
    return os.fstat(file.fileno()).st_size


def read_bytes(path: Path, what: str, at_most: int | None = None) -> bytes:
    """The content of a file; InputError where it can't be read, or is larger than `at_most` or the memory allows."""
    try:
        with open_file(path) as file:
            size = size_of(file)
            if at_most is not None and size > at_most:
                raise InputError(
                    f"{path} has {memory.text_of(size)} but {what} of {memory.text_of(at_most)} at most is needed; "
                    "check which file it is."
                )
            memory.check(size, str(path))
            return file.read(size)
    except FileNotFoundError:
        raise InputError(f"{path} is missing but it is needed; restore it or name another.") from None
    except OSError as error:
        raise InputError(f"{path} can't be read ({error.strerror}) but {what} is needed; check it.") from None


@contextmanager
def npz_archive(path: Path, advice: str) -> Iterator[ZipFile]:
    """An .npz file, open; whatever goes wrong with it becomes an InputError, in which `advice` says what to do."""
    try:
        with open_file(path) as file, ZipFile(file) as archive:
            yield archive
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{path} is missing but it is needed; restore it or name another.") from None
    except Exception as error:  # damaged archives raise anything
        raise InputError(f"{path} can't be read ({reason_of(error)}); {advice}.") from None


def read_npz(
    path: Path, advice: str, names: tuple[str, ...] | None = None, at_most: int | None = None
) -> dict[str, np.ndarray]:
    """The arrays of an .npz file, of numbers only, or those of `names` that it holds; none is unpickled.

    Raises
    ------
    InputError
        If the file can't be read, or its arrays would take more bytes than `at_most` or the memory allows; `advice`
        says what to do.
    """
    with npz_archive(path, advice) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        chosen = {name: info for name, info in members.items() if names is None or name in names}
        size = sum(info.file_size for info in chosen.values())
        if at_most is not None and size > at_most:
            raise ValueError(f"it holds {memory.text_of(size)} but {memory.text_of(at_most)} at most is needed")
        memory.check(size, f"what {path} holds")
        found = {}
        for name, info in chosen.items():
            with archive.open(info) as stream:
                found[name] = read_array(stream, info.file_size)
            if found[name].dtype.kind not in "biuf":
                raise ValueError(f"{name[:60]!r} holds {found[name].dtype}, not numbers")
        return found


def array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether Fortran's order, and kind of the array that an open .npy file holds; ValueError where it can't be.

    The stream stands at the first sample then.
    """
    version = np.lib.format.read_magic(stream)  # type: ignore[arg-type]
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"version {version}")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(stream)  # type: ignore[arg-type]
    if dtype.hasobject:
        raise ValueError("it holds objects, not numbers")
    if any(n < 0 for n in shape):
        raise ValueError(f"its size is {shape}")
    return shape, fortran, dtype


def read_array(stream: IO[bytes], size: int) -> np.ndarray:
    """The array of an open .npy file of `size` bytes; ValueError where it claims more than it holds."""
    shape, fortran, dtype = array_header(stream)
    count = prod(shape)
    if count * dtype.itemsize > size:
        raise ValueError(f"it is truncated: {shape} {dtype} in {size} bytes")
    flat = np.empty(count, dtype)
    target = memoryview(flat.view(np.uint8).data) if flat.nbytes else memoryview(b"")
    at = 0
    while at < len(target):
        read = stream.readinto(target[at:])  # type: ignore[attr-defined]
        if not read:
            raise ValueError("it is truncated")
        at += read
    return flat.reshape(shape, order="F" if fortran else "C")


def reason_of(error: BaseException) -> str:
    """The first line of what an exception says."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:200]
