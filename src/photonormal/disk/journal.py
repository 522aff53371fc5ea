"""What a batch writes, noted step by step in a file, so that any end of the process can be put right."""

from __future__ import annotations

import errno
import json
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from photonormal.disk.locking import lock
from photonormal.types import InputError

PARTIAL = ".photonormal-partial"  # folder of the journal and of the files to come and to go
NAME = "journal"
HEADER = {"written by": "photonormal"}  # first line
LONGEST = 2**26  # bytes of a journal
LOOKS_S = (0, 0.01, 0.1)  # at a folder that others may make and remove several times during one look
NO_MOVES: dict[str, Any] = {"old": [], "new": {}, "folders": []}


class Journal:
    """The journal of a batch in `folder`, open and locked. Lines of JSON: HEADER, files, moves, done.

    {"file": name}      before a file of the batch is begun
    {"old": [name],     what is moved aside,
     "new": {name: stamp}, "folders": [name]}   and what is put into place
    {"done": true}      after the moves; before it they can be undone
    """

    def __init__(self, folder: Path, file: int) -> None:
        self.folder, self.file = folder, file
        self.new, self.old = folder / PARTIAL / "new", folder / PARTIAL / "old"

    @classmethod
    def locked(cls, folder: Path) -> Journal | None:
        """The journal of a folder, made if need be; None where another process has it."""
        partial = folder / PARTIAL
        path = partial / NAME
        try:
            partial.mkdir()
        except FileExistsError:
            if not any(_ours(partial, after_s) for after_s in LOOKS_S):
                raise InputError(f"{partial} is not of photonormal, which needs that name; rename it.") from None
        try:
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except FileNotFoundError:  # another process has just removed its own folder
            return None
        try:
            if lock(file) and path.exists() and os.path.samestat(os.fstat(file), path.stat()):
                return cls(folder, file)
        except BaseException:
            os.close(file)
            raise
        os.close(file)
        return None

    def begin(self) -> None:
        """Empty the journal, for a batch of its own."""
        os.ftruncate(self.file, 0)
        self.tell(HEADER)

    def tell(self, entry: dict[str, Any]) -> None:
        """Add a line."""
        line = json.dumps(entry).encode() + b"\n"
        if os.write(self.file, line) < len(line):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def entries(self) -> list[dict[str, Any]]:
        """The lines; not the last one where a kill or a full disk cut it.

        Raises
        ------
        InputError
            If they are none of a batch's, or name anything that lies elsewhere: the folder may be another's work.
        """
        os.lseek(self.file, 0, os.SEEK_SET)
        data = os.read(self.file, LONGEST)
        try:
            found = [json.loads(line) for line in data.split(b"\n")[:-1]]
            for entry in found:
                for name in _names(entry):
                    self._check_name(name)
        except (ValueError, TypeError, AttributeError, RecursionError):
            partial = self.folder / PARTIAL
            raise InputError(
                f"{partial} was not left by a run of photonormal; look at its content, then remove it."
            ) from None
        return found

    def _check_name(self, name: str) -> None:
        """ValueError for what can be no file of the folder, or is reached through a link."""
        path = Path(name)
        if path.is_absolute() or path.drive or ".." in path.parts or not path.parts:
            raise ValueError
        above = [base / p for base in (self.new, self.old, self.folder) for p in path.parents]
        if any(p.is_symlink() for p in above if p != self.folder):
            raise ValueError

    def move(self, moves: dict[str, Any]) -> None:
        """Put the new files into place and the old ones aside, all or none.

        Raises
        ------
        OSError
            Everything is as it was before, unless undoing the moves failed, too.
        """
        self.tell(moves)
        os.fsync(self.file)
        try:
            for name in moves["old"]:
                aside = self.old / name
                aside.parent.mkdir(parents=True, exist_ok=True)
                os.rename(self.folder / name, aside)
            for name in moves["folders"]:
                (self.folder / name).mkdir()
            for name in moves["new"]:
                _rename(self.new / name, self.folder / name)
            sync(self.folder)
            self.tell({"done": True})
        except OSError:
            self.undo(moves)
            raise

    def undo(self, moves: dict[str, Any]) -> None:
        """Where `move` ended at any point, or `undo` itself, make everything as it was before."""
        for name, told in moves["new"].items():
            if not os.path.lexists(self.new / name) and stamp(self.folder / name) == told:
                _rename(self.folder / name, self.new / name)
        for name in moves["old"]:
            if os.path.lexists(self.old / name):
                _rename(self.old / name, self.folder / name)
        for name in reversed(moves["folders"]):
            with suppress(OSError):  # not there, or somebody has put something in
                (self.folder / name).rmdir()

    def untouched(self, old: list[str], new: list[str]) -> bool:
        """True where no move has been made, or all have been undone."""
        aside, waiting = (self.old / name for name in old), (self.new / name for name in new)
        return not any(map(os.path.lexists, aside)) and all(map(os.path.lexists, waiting))

    def settle(self) -> None:
        """Undo moves that were not done, and remove the batch's files that are not in place, by their names."""
        entries = self.entries()
        moves = next((e for e in entries if "old" in e), NO_MOVES)
        if not any("done" in e for e in entries):
            self.undo(moves)
        for place, names in ((self.new, [e["file"] for e in entries if "file" in e]), (self.old, moves["old"])):
            for name in names:
                (place / name).unlink(missing_ok=True)
            folders = {place / parent for name in names for parent in Path(name).parents}
            for path in sorted(folders, reverse=True):  # what lies in a folder comes before it
                with suppress(FileNotFoundError):
                    path.rmdir()

    def end(self) -> None:
        """Remove the journal, which has nothing left to undo, and its folder."""
        path = self.folder / PARTIAL / NAME
        if os.name == "nt":  # what is open can't be removed
            self.close()
        path.unlink()
        self.close()
        path.parent.rmdir()

    def close(self) -> None:
        """Unlock it and let it be."""
        if self.file >= 0:
            file, self.file = self.file, -1
            os.close(file)


def _ours(partial: Path, after_s: float) -> bool:
    """True for a folder that a batch of ours has made, is making or is just removing; a look at it after a while."""
    time.sleep(after_s)
    if partial.is_symlink() or not partial.is_dir():
        return not os.path.lexists(partial)  # gone since
    journal = partial / NAME
    try:
        if journal.is_symlink() or not journal.is_file():
            return not any(partial.iterdir()) or (journal.is_file() and not journal.is_symlink())  # made since
        return json.dumps(HEADER).encode().startswith(journal.read_bytes()[:100].partition(b"\n")[0])
    except FileNotFoundError:
        return True


def _names(entry: dict[str, Any]) -> list[str]:
    """All names in a line; ValueError, TypeError or AttributeError where it is none of a batch's."""
    moved = [*entry.get("old", []), *entry.get("new", {}).keys(), *entry.get("folders", [])]
    if "old" in entry and not entry.keys() == NO_MOVES.keys():
        raise ValueError
    return [*moved, *([entry["file"]] if "file" in entry else [])]


def _rename(path: Path, to: Path) -> None:
    """Never over anything that exists."""
    if os.path.lexists(to):
        raise FileExistsError(errno.EEXIST, "a file of this name has just appeared", str(to))
    os.rename(path, to)


def stamp(path: Path) -> list[int] | None:
    """Tells a file from another that comes to have its name."""
    try:
        status = path.lstat()
    except FileNotFoundError:
        return None
    return [status.st_size, status.st_mtime_ns]


def sync(path: Path) -> None:
    """Have the disk itself take what was written."""
    folder = path.is_dir()
    if folder and os.name == "nt":  # which can't
        return
    file = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    try:
        os.fsync(file)
    finally:
        os.close(file)
