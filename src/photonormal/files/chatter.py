"""What libraries print while they decode: kept from the terminal, and heard.

They print to file descriptor 2, or by Python's streams. The descriptor belongs to the whole process, so threads share
one redirection as long as any of them decodes. Nobody can know then who printed: a decoding during which anything was
printed is done once more, alone.
"""

from __future__ import annotations

import atexit
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Any, BinaryIO, TypeVar

T = TypeVar("T")

_turn = threading.Condition()
_decoding: set[int] = set()  # threads
_alone = False  # whether one of them has to be alone
_paper: BinaryIO | None = None  # where what is printed goes meanwhile
_terminal: int | None = None  # where descriptor 2 leads else
_streams: tuple[Any, Any, Any] = (None, None, None)  # Python's output and errors, and one that leads to the terminal


def heard(decode: Callable[[], T]) -> tuple[T | Exception, str]:
    """What `decode` returns or raises, and what was printed by it, and by nothing else."""
    with _listening(alone=False) as start:
        result = _outcome(decode)
        if _length() == start:
            return result, ""
    with _listening(alone=True) as start:
        return _outcome(decode), _text(start)


def _outcome(decode: Callable[[], T]) -> T | Exception:
    try:
        return decode()
    except Exception as error:
        return error


@contextmanager
def _listening(alone: bool) -> Iterator[int]:
    """What is printed goes to a file while the block runs; yields the file's length before."""
    global _alone
    thread = threading.get_ident()
    with _turn:
        _turn.wait_for(lambda: not _alone and not (alone and _decoding))
        if not _decoding:
            _redirect()
        _decoding.add(thread)
        _alone = alone
        start = _length()
    try:
        yield start
    finally:
        with _turn:
            _decoding.remove(thread)
            _alone = False
            if not _decoding:
                _restore()
            _turn.notify_all()


class _Aside:
    """One of Python's streams: what a decoding thread prints is heard, all else goes where it always went."""

    def __init__(self, stream: Any):
        self.stream = stream

    def write(self, text: str) -> int:
        if threading.get_ident() not in _decoding or _paper is None:
            return self.stream.write(text)
        _paper.write(text.encode("utf-8", "replace"))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def _redirect() -> None:
    global _paper, _terminal, _streams
    try:
        _terminal = os.dup(2)
    except OSError:  # a process without standard error
        return
    if _paper is None:
        _paper = tempfile.TemporaryFile(buffering=0)
        atexit.register(_paper.close)
    _paper.seek(0)
    _paper.truncate()
    errors, own = sys.stderr, None
    if errors is not None and _descriptor(errors) == 2:
        errors.flush()
        raw: Any = os.fdopen(os.dup(2), "wb", 0)
        own = TextIOWrapper(raw, errors.encoding, errors.errors, write_through=True)
    _streams = sys.stdout, errors, own
    sys.stdout, sys.stderr = _Aside(sys.stdout), _Aside(own or errors)
    os.dup2(_paper.fileno(), 2)


def _restore() -> None:
    global _terminal
    if _terminal is None:
        return
    os.dup2(_terminal, 2)
    os.close(_terminal)
    _terminal = None
    sys.stdout, sys.stderr, own = _streams
    if own is not None:
        own.close()


def _descriptor(stream: Any) -> int | None:
    try:
        return stream.fileno()
    except (OSError, ValueError, AttributeError):  # a notebook's, a test's
        return None


def _length() -> int:
    return 0 if _paper is None else os.fstat(_paper.fileno()).st_size


def _text(start: int) -> str:
    """What was printed since; while nothing else decodes, since reading moves the place where printing goes on."""
    if _paper is None or _terminal is None:
        return ""
    _paper.seek(start)
    text = _paper.read(4000).decode("utf-8", "replace")
    _paper.seek(0, os.SEEK_END)
    return text
