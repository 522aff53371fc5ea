import pytest

from photonormal.cli import main
from tests.relighting.test_files import dome, glossy
from tests.scenes import write_diligent


@pytest.fixture(scope="session")
def measured(tmp_path_factory):
    """A folder with photographs, `ball`, and the result of them, `r`; tests change nothing in it."""
    folder = tmp_path_factory.mktemp("measured")
    write_diligent(folder / "ball", glossy(dome(40)))
    assert main(["measure", str(folder / "ball"), "--out", str(folder / "r"), "--method", "woodham"]) == 0
    return folder


@pytest.fixture
def refused(measured, tmp_path, capsys):
    """A call of `export` that must end with one line, exit code 2, and nothing written into `tmp_path`."""

    def call(*words, says, result=measured / "r"):
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        assert main(["export", str(result), *map(str, words)]) == 2
        err = capsys.readouterr().err
        assert says in err and len(err.splitlines()) == 1 and sorted(tmp_path.rglob("*")) == before

    return call
