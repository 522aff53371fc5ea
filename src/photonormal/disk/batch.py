"""Files that appear in a folder at once, or not at all.

While a batch is written, its folder holds

    .photonormal-partial/
        journal     locked by the process that writes, see `photonormal.disk.journal`
        new/        files to come
        old/        files that they replace

At the end of the batch the journal gets what goes where, the old files are moved aside, the new ones into place, and
the journal notes that it is done. Whatever happens before that last line, the moves are undone: at once after an
error, by the next run after `kill -9`. Only files that the journal names are ever moved or removed.
"""

from __future__ import annotations

import errno
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias

from photonormal.disk.journal import PARTIAL, Journal, stamp, sync
from photonormal.disk.locking import uninterrupted
from photonormal.disk.refusals import NOTHING, InUse, refuse_folder, unwritable

Content: TypeAlias = bytes | memoryview | Callable[[BinaryIO], object]  # of a file, or what writes it into one

log = logging.getLogger(__name__)

WAIT_SECONDS = 60.0  # for another process that writes a few files
AT_A_TIME = 16  # files that the disk is to take: together they cost it little more than one
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EROFS}  # errors that only writing meets


class FileBatch:
    """Files to appear in `folder`: ``batch / name`` is where to write one for now; see `at_once`.

    `remove` names files of the folder that go when the new ones come.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: list[str] = []
        self.remove: list[str] = []
        self.after = NOTHING  # what a failure has left behind, in words
        self._made: list[Path] = []  # folders that were not there before
        self._journal: Journal | None = None
        self._turn, self._ended = threading.Lock(), False

    def __truediv__(self, name: str) -> Path:
        path = self.journal.new / name
        if name not in self.names:
            refuse_folder(self.folder / name)
            with _told(self):
                self.journal.tell({"file": name})
                self.names.append(name)
                path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def write(self, name: str, content: Content) -> None:
        """Write one of the files; from any thread, but RuntimeError once the batch has ended."""
        with self._turn:
            if self._ended:
                raise RuntimeError(f"{self.folder} is no longer written")
            path = self / name
            with _told(self), path.open("wb") as file:
                content(file) if callable(content) else file.write(content)

    def inside(self, name: str) -> Inside:
        """A folder in the folder, to write files into in the same way."""
        return Inside(self, name)

    def sizes(self) -> dict[str, int]:
        """Bytes of each file written so far."""
        return {name: (self / name).stat().st_size for name in self.names}

    @property
    def journal(self) -> Journal:
        """Where the batch is written down step by step."""
        assert self._journal is not None, "the batch is not open"
        return self._journal

    def open(self, wait_seconds: float) -> None:
        """Make the folder, lock it, and clear up what a killed run left there."""
        deadline = time.monotonic() + wait_seconds
        with uninterrupted():
            self._made = _make(self.folder)
        while not self._taken():
            if time.monotonic() >= deadline:
                raise InUse(
                    f"{self.folder} is being written by another photonormal; wait for it or choose another --out."
                )
            time.sleep(0.02)

    def _taken(self) -> bool:
        with uninterrupted():
            self._journal = Journal.locked(self.folder)
            if self._journal is not None:
                _clear_up(self._journal)
                self._journal.begin()
        return self._journal is not None

    def commit(self) -> None:
        """Put the files into place, all or none."""
        with ThreadPoolExecutor(AT_A_TIME) as pool:
            list(pool.map(sync, [self / name for name in self.names]))
        with uninterrupted():
            old = [n for n in dict.fromkeys([*self.remove, *self.names]) if os.path.lexists(self.folder / n)]
            for name in old:
                refuse_folder(self.folder / name)
            new = {name: stamp(self / name) for name in self.names}
            folders = {str(p) for n in self.names for p in Path(n).parents if not (self.folder / p).exists()}
            self.after = f" What was there lies in {self.folder / PARTIAL}; the next run puts it back."
            try:
                self.journal.move({"old": old, "new": new, "folders": sorted(folders)})
            except OSError:
                if self.journal.untouched(old, list(new)):
                    self.after = NOTHING
                raise
            self._made = []

    def close(self) -> None:
        """Remove what is left of the batch."""
        with uninterrupted(), self._turn:
            self._ended = True
            if self._journal is not None:
                try:
                    with suppress(OSError):  # what can't be removed now, the next run removes
                        self._journal.settle()
                        self._journal.end()
                finally:
                    self._journal.close()
            for folder in reversed(self._made):
                with suppress(OSError):
                    folder.rmdir()


@dataclass(frozen=True)
class Inside:
    """A folder of a batch: ``inside / name`` is where to write a file of it for now."""

    batch: FileBatch
    name: str

    def __truediv__(self, name: str) -> Path:
        return self.batch / f"{self.name}/{name}"

    def inside(self, name: str) -> Inside:
        """A folder in this folder."""
        return Inside(self.batch, f"{self.name}/{name}")


@contextmanager
def at_once(folder: Path, wait_seconds: float = WAIT_SECONDS) -> Iterator[FileBatch]:
    """A batch whose files appear in `folder` when the block ends well; the folder is made if need be.

    Raises
    ------
    InputError
        If the folder can't be written, or another process still writes there after `wait_seconds`.
    """
    batch = FileBatch(folder)
    try:
        with _told(batch):
            batch.open(wait_seconds)
        try:
            yield batch
        except OSError as error:
            if error.errno in FULL or PARTIAL in Path(str(error.filename)).parts:
                raise unwritable(folder, error) from None
            raise
        with _told(batch):
            batch.commit()
    finally:
        batch.close()


@contextmanager
def _told(batch: FileBatch) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise unwritable(batch.folder, error, batch.after) from None


def write(path: Path, content: Content) -> None:
    """Write one file into a folder that exists: a reader never sees half of it."""
    if not path.parent.is_dir():
        raise unwritable(path, FileNotFoundError(errno.ENOENT, ""))
    with at_once(path.parent) as batch:
        batch.write(path.name, content)


def recover(folder: Path) -> None:
    """Clear up what a killed run left in a folder, if there is anything and no process is at work there."""
    if not (folder / PARTIAL).is_dir():
        return
    try:
        with uninterrupted():
            journal = Journal.locked(folder)
            if journal is not None:
                try:
                    _clear_up(journal)
                    journal.end()
                finally:
                    journal.close()
    except OSError as error:
        raise unwritable(folder, error, f" A run that was killed left {folder / PARTIAL} there.") from None


def in_use(folder: Path) -> bool:
    """Whether another process writes into a folder; what a killed run left there is cleared up."""
    recover(folder)
    return (folder / PARTIAL).is_dir()


def _clear_up(journal: Journal) -> None:
    """Settle the journal of a run that was killed, and say so."""
    entries = journal.entries()
    if not entries:
        return
    journal.settle()
    undone = any(e.get("old") for e in entries) and not any("done" in e for e in entries)
    back = "; the files that it was replacing are back" if undone else ""
    log.warning("photonormal: a run that was killed left files in %s; they are removed%s.", journal.folder, back)


def _make(folder: Path) -> list[Path]:
    """Make a folder and those above it; returns those that were not there, the uppermost first."""
    made: list[Path] = []
    try:
        for path in [*reversed(folder.parents), folder]:
            if not path.is_dir():
                with suppress(FileExistsError):  # another process was faster, or a file is there
                    path.mkdir()
                    made.append(path)
        if not folder.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    except OSError:
        for path in reversed(made):
            path.rmdir()
        raise
    return made
