"""What a result depends on: the code that a method runs through, and the files that were read."""

import ast
import hashlib
import shutil

import pytest

from photonormal import provenance
from photonormal.files.opening import noted, open_file, read_bytes
from photonormal.methods.learned import weights
from photonormal.provenance import change, changed, inputs, made_by
from photonormal.types import InputError


def test_the_digest_follows_what_a_method_runs_through(monkeypatch, tmp_path):
    package = tmp_path / "photonormal"
    shutil.copytree(provenance.PACKAGE, package, ignore=shutil.ignore_patterns("weights", "data", "__pycache__"))
    monkeypatch.setattr(provenance, "PACKAGE", package)
    woodham, l1 = "photonormal.methods.classical.woodham", "photonormal.methods.classical.l1"
    before = [provenance.source_sha256(m) for m in (woodham, l1)]
    (package / "bench" / "page" / "html.py").write_text("")
    (package / "methods" / "classical" / "ward.py").write_text("")
    assert [provenance.source_sha256(m) for m in (woodham, l1)] == before
    with (package / "methods" / "classical" / "l1.py").open("a") as file:
        file.write("# edited\n")
    assert provenance.source_sha256(woodham) == before[0] and provenance.source_sha256(l1) != before[1]
    with (package / "shading.py").open("a") as file:  # both compute with it
        file.write("# edited\n")
    assert provenance.source_sha256(woodham) != before[0]


def test_all_that_a_module_imports_of_photonormal_is_seen():
    for path in provenance.PACKAGE.rglob("*.py"):
        source, imported = path.read_bytes(), set()
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ImportFrom) and node.module:
                imported |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
            elif isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
        seen = set(provenance._imports(source))
        assert seen >= {name for name in imported if name.split(".")[0] == "photonormal"}, path


def test_a_program_is_told_by_all_its_code_whatever_the_line_ends(monkeypatch, tmp_path):
    def told(content: bytes, name: str = "a.py") -> provenance.ProgramVersion:
        (tmp_path / name).write_bytes(content)
        return provenance.program.__wrapped__()

    monkeypatch.setattr(provenance, "PACKAGE", tmp_path)
    first = told(b"a = 1\nb = 2\n")
    assert told(b"a = 1\r\nb = 2\r\n") == first and told(b"anything", "a.md") == first
    assert told(b"a = 2\nb = 2\n") != first


def test_what_was_read_is_told_from_what_has_changed(tmp_path):
    for name in ("a.txt", "b.txt", "beside.txt"):
        (tmp_path / name).write_text(name)
    with noted() as opened:
        read_bytes(tmp_path / "a.txt", "a text")
        read_bytes(tmp_path / "b.txt", "a text")
    before = inputs(tmp_path, opened)
    assert set(before["files"]) == {"a.txt", "b.txt"} and before["beside"] == ["beside.txt"]
    (tmp_path / "a.txt").write_text("a.txt")  # another time, the same content
    (tmp_path / ".hidden").write_text("of a file browser")
    (tmp_path / "result").mkdir()
    assert changed(tmp_path, before) == ""
    (tmp_path / "beside.txt").write_text("not read, so it may change")
    assert changed(tmp_path, before) == ""
    (tmp_path / "mask.png").write_text("")
    assert changed(tmp_path, before) == "mask.png has come"
    (tmp_path / "a.txt").write_text("A.txt")
    assert changed(tmp_path, before) == "a.txt has changed"
    (tmp_path / "a.txt").unlink()
    assert changed(tmp_path, before) == "a.txt is gone"


def test_what_was_read_whole_is_not_read_again(tmp_path, monkeypatch):
    (tmp_path / "whole.png").write_bytes(bytes(range(256)) * 400)
    (tmp_path / "begun.png").write_bytes(b"0" * 100_000)
    again = []
    with noted() as opened:
        with open_file(tmp_path / "whole.png") as file:
            file.read(10)
        with open_file(tmp_path / "whole.png") as file:
            assert file.read(64) == bytes(range(64))  # as a header is
            file.seek(0)
            assert len(file.read()) == 102_400
        with open_file(tmp_path / "begun.png") as file:
            file.read(10)
        monkeypatch.setattr(provenance, "open_file", lambda path: again.append(path.name) or open_file(path))
        told = inputs(tmp_path, opened)["files"]
    assert again == ["begun.png"]
    for name in ("whole.png", "begun.png"):
        assert told[name]["sha256"] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()


def test_what_goes_or_grows_while_it_is_read_is_refused(tmp_path):
    for name in ("a.png", "b.png"):
        (tmp_path / name).write_bytes(b"abc")
    with noted() as opened:
        read_bytes(tmp_path / "a.png", "a picture")
        read_bytes(tmp_path / "b.png", "a picture")
    (tmp_path / "b.png").write_bytes(b"abcd")
    with pytest.raises(InputError, match=r"b.png has changed while it was read"):
        inputs(tmp_path, opened)
    (tmp_path / "a.png").unlink()
    with pytest.raises(InputError, match=r"a.png is gone; it was there"):
        inputs(tmp_path, opened)


def test_the_network_that_tells_lights_counts_where_they_are_unknown(monkeypatch, tmp_path):
    given, unknown = (made_by("woodham", {}, lights) for lights in ("given", "unknown"))
    assert change(given, made_by("woodham", {})) is None
    assert given["source_sha256"] != unknown["source_sha256"] and "lights_sha256" not in given
    (tmp_path / "sdps-lights.safetensors").write_bytes(b"others")
    monkeypatch.setattr(weights, "SHIPPED", tmp_path)
    assert change(given, made_by("woodham", {})) is None
    assert change(unknown, made_by("woodham", {}, "unknown")) == (
        "lights_sha256",
        "other weights of the network that finds lights",
    )
