"""What a method's code is: a digest of every module of photonormal that it runs through."""

from __future__ import annotations

import ast
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
ENGINE = ("photonormal.methods.engine.samples", "photonormal.methods.engine.stream", "photonormal.methods.engine.near")
BESIDES = {"photonormal", "photonormal.methods", "photonormal.types", "photonormal.options"}  # names and checks


def source_sha256(module: str) -> str:
    """SHA-256 of a method's module, of the engine, and of all modules of photonormal that they import."""
    found: dict[str, bytes] = {}
    waiting = [module, *ENGINE]
    while waiting:
        name = waiting.pop()
        file = _file(name)
        if file is None or name in found or name in BESIDES:
            continue
        found[name] = file.read_bytes()
        waiting += _imports(found[name])
    digest = hashlib.sha256()
    for name in sorted(found):
        digest.update(name.encode() + b"\0" + found[name].replace(b"\r\n", b"\n") + b"\0")
    return digest.hexdigest()


def _imports(source: bytes) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    return [name for name in names if name.split(".")[0] == "photonormal"]


def _file(module: str) -> Path | None:
    place = PACKAGE.joinpath(*module.split(".")[1:])
    return next((p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()), None)
