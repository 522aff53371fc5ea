"""Mitsuba 3, with the fastest of its variants that can't end the process.

The vectorised variant compiles kernels with LLVM. Versions 14 to 16 abort the whole process on the first kernel, which
no Python code can catch, so that the library's version is read off its file's name before anything is loaded. Without
LLVM 17 or later the scalar variant answers, which needs no system package and is many times slower.
"""

from __future__ import annotations

import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

from photonormal.types import InputError

OLDEST = 17  # version of LLVM that compiles every kernel
FAST, SLOW = "llvm_ad_rgb", "scalar_rgb"
FOLDERS = (
    "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu",
    "/opt/homebrew/opt/llvm/lib", "/usr/local/opt/llvm/lib",
)  # fmt: skip


@lru_cache(maxsize=1)
def mitsuba() -> Any:
    """The module `mitsuba` with a variant set: one that is already set, else the vectorised, else the scalar one.

    Raises
    ------
    InputError
        If Mitsuba is not installed.
    """
    try:
        import mitsuba as mi
    except ImportError:
        raise InputError(
            "Mitsuba is not installed but the path tracer is built on it; pip install 'photonormal[synth]'."
        ) from None
    if mi.variant() is None:
        library = llvm()
        if library is not None:
            os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
        mi.set_variant(FAST if library else SLOW)
    return mi


def vectorised() -> bool:
    """Whether many rays are traced at once."""
    return not str(mitsuba().variant()).startswith("scalar")


def llvm() -> Path | None:
    """The newest LLVM library of a usable version; the one that DRJIT_LIBLLVM_PATH names, where it is set."""
    given = os.environ.get("DRJIT_LIBLLVM_PATH")
    if given:
        return Path(given) if Path(given).is_file() and version(Path(given)) >= OLDEST else None
    found = [p for folder in FOLDERS for p in Path(folder).glob("libLLVM*") if p.is_file()]
    found += [p for p in Path("/usr/lib").glob("llvm-*/lib/libLLVM*") if p.is_file()]
    usable = [p for p in found if version(p) >= OLDEST]
    return max(usable, key=version) if usable else None


def version(library: Path) -> int:
    """Major version of an LLVM library, from the names of the file and of what it links to; 0: unknown.

    >>> [version(Path(p)) for p in ("libLLVM.so.19.1", "libLLVM-17.so.1", "libLLVM-14.0.6.so.1", "libLLVM.so")]
    [19, 17, 14, 0]
    """
    for name in (library.name, library.resolve().name, library.resolve().parent.parent.name):
        number = re.search(r"(?:libLLVM-|libLLVM\.so\.|libLLVM\.|llvm-|llvm@)(\d+)", name, re.IGNORECASE)
        if number:
            return int(number[1])
    return 0
