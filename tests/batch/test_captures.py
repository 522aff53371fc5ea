"""Which captures are found, and what they are called."""

from pathlib import Path

import pytest

import photonormal as pn
from photonormal.batch.captures import jobs
from photonormal.cli.batching import kinds
from photonormal.job import Job
from photonormal.types import InputError
from tests.scenes import lambertian, ring, sphere, write_diligent


@pytest.fixture
def place(tmp_path, monkeypatch):
    for name in ("1/front", "1/back", "2/front", "10/front", "sphere", "results/1"):
        (tmp_path / "season" / name).mkdir(parents=True)
    (tmp_path / "season" / "notes.txt").write_text("")
    (tmp_path / "season" / "dome.lp").write_text("")
    monkeypatch.chdir(tmp_path)


def found(*captures, **like):
    return jobs(captures, Path("season/results"), Job(Path(), Path(), **like), kinds()).captures


def names(*captures, **like):
    return [named.name for named in found(*captures, **like)]


def test_names_are_paths_below_the_fixed_part(place, monkeypatch):
    assert names("season/*", sphere="season/sphere") == ["1", "2", "10", "dome"]
    assert names("season/*/front") == ["1/front", "2/front", "10/front"]
    assert names("season/1/front", "season/2/front") == ["1/front", "2/front"]  # as a shell gives them
    assert names("season/1", "season/1", "season/dome.lp") == ["1", "dome"]
    monkeypatch.chdir("season/1")
    assert names(".") == ["1"]
    monkeypatch.chdir("../..")
    assert found("season/1/*")[0].job.out == Path("season/results/back")
    assert names("season/1/**") == ["back", "front"]  # which matches season/1, too


def test_a_list_has_options_of_its_own(place, tmp_path):
    text = "capture;name;mask;ring;elevation;srgb;method;mesh\n1/front;a;m.png;8;40,5;true;l1;false\n2/front;b;;;;;;\n"
    (tmp_path / "season" / "list.csv").write_text(text)
    one, two = found("season/list.csv", reading={"srgb": False, "mask": None})
    assert one.job.capture == Path("season/1/front") and one.job.method == "l1" and one.job.integration is None
    reading = {"srgb": True, "mask": Path("season/m.png"), "ring": 8, "elevation": 40.5}
    assert one.job.reading == reading
    assert two.job.reading == {"srgb": False, "mask": None} and two.job.integration == "quadratic"
    (tmp_path / "season" / "list.toml").write_text(
        '[[capture]]\ncapture = "1/front"\nname = "a"\nmask = "m.png"\nring = 8\nelevation = 40.5\nsrgb = true\n'
    )
    assert found("season/list.toml")[0].job.reading == reading


def test_a_list_is_read_as_spreadsheets_write_it(place, tmp_path):
    text = "Capture; Name ;Sphere\r\n1/front;K\xf6nig;balls\r\n;;\r\n2/front;;\r\n;;\r\n"
    (tmp_path / "season" / "list.csv").write_bytes(text.encode("latin-1"))
    (tmp_path / "tabs.csv").write_text("capture\tcrop\timages\tscale\nseason/1/front\t1,2,3,4\t1,2\t0,5\n")
    assert found("tabs.csv")[0].job.reading == {"crop": "1,2,3,4", "images": "1,2", "scale": 0.5}
    two, one = found("season/list.csv")
    assert one.name == "K\xf6nig" and one.job.sphere == str(tmp_path / "season" / "balls")
    assert two.name == "front" and two.job.sphere == ""
    (tmp_path / "season" / "1" / "front" / "balls").mkdir()  # the capture's own comes first
    assert found("season/list.csv")[1].job.sphere == str(tmp_path / "season" / "1" / "front" / "balls")


def test_what_a_list_says_of_a_capture_holds_beside_a_pattern(place, tmp_path):
    (tmp_path / "list.csv").write_text("capture,method\nseason/1/front,l1\n")
    for given in (("list.csv", "season/1/*"), ("season/1/*", "list.csv")):
        assert {named.name: named.job.method for named in found(*given)} == {"back": "normalnet", "front": "l1"}
    (tmp_path / "list.csv").write_text("capture,name,method\nseason/1/front,a,\nseason/1/front,b,l1\n")
    assert [(named.name, named.job.method) for named in found("list.csv")] == [("a", "normalnet"), ("b", "l1")]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("capture,ring\n1,many\n", "capture 1: ring many came but a whole number"),
        ('capture,elevation\n1,"40,5,1"\n', "capture 1: elevation 40,5,1 came but a number is needed"),
        ("capture,srgb\n1,yes\n", "capture 1: srgb yes came but true or false is needed"),
        ("capture,rings\n1,8\n", "has the option 'rings', which there is not"),
        ("capture,name\n1,../x\n", "is called '../x'"),
        ("capture,name\n1,a//b\n", "is called 'a//b'"),
        (f"capture,name\n1,{'n' * 300}\n", "but a name for its folder of results is needed, of at most 255 bytes"),
        ("capture,name\n1,first, left\n", "has 'left' in the row of '1', beyond its columns"),
        ("capture,method\n1,\n1,l1\n", "1 is listed twice with different options, and would be called 1 both"),
        ("name\n1\n", "no column `capture`"),
        ("capture\n", "no column `capture`"),
        ("capture,name\n1,\n,b\n", "capture 2 has no `capture`"),
        ("capture,name\n1,a\n2,a\n", "would both be called a"),
        ("capture,name\n1,a\n2,a/b\n", "a/b lies in a"),
    ],
)
def test_a_list_that_cannot_be_used_is_refused(place, tmp_path, text, says):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(InputError, match=says.replace("[", r"\[")):
        found("list.csv")


def test_toml_that_cannot_be_used_is_refused(place, tmp_path):
    for text, says in (("a =", "is no TOML"), ("capture = 1", r"no \[\[capture\]\]")):
        (tmp_path / "list.toml").write_text(text)
        with pytest.raises(InputError, match=says):
            found("list.toml")


def test_what_matches_nothing_says_what_lies_there(place):
    with pytest.raises(InputError, match=r"no capture matches season/v\*: .* but season holds 1/, 10/, 2/, dome.lp"):
        found("season/v*")
    with pytest.raises(InputError, match="summer does not exist"):
        found("summer/*")


def test_a_folder_of_captures_is_told_how_it_is_given(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "dome.lp").write_text("1\n1.png 0 0 1\n")
    with pytest.raises(InputError, match=r"or give all folders to `photonormal batch '.*/\*'`"):
        pn.load(tmp_path)
    for name in ("a", "b"):
        write_diligent(tmp_path / name, lambertian(sphere(8), ring(3)))
    with pytest.raises(InputError, match=r"or give all of them to `photonormal batch '.*/\*'`"):
        pn.load(tmp_path)


def test_files_that_are_no_captures_are_named_and_left_out(place, tmp_path):
    (tmp_path / "season" / "gone").symlink_to("nowhere")  # such as a disk that is not there: it fails by itself
    given = jobs(["season/*"], Path("season/results"), Job(Path(), Path()), kinds())
    assert [named.name for named in given.captures] == ["1", "2", "10", "dome", "gone", "sphere"]
    assert given.left_out == [Path("season/notes.txt")]
    given = jobs(["season/1", "season/notes.txt"], Path("out"), Job(Path(), Path()), kinds())  # as a shell gives them
    assert [named.name for named in given.captures] == ["1"] and given.left_out == [Path("season/notes.txt")]
    with pytest.raises(InputError, match=r"season/notes.txt is a file but folders, .lp files or a list"):
        found("season/notes.txt")


def test_results_are_no_captures_whoever_names_them(place):
    assert names("season/1", "season/results", "season/results/1") == ["1"]  # as a shell gives them
    for given in (["season/results/*"], ["season/results/1"], []):
        with pytest.raises(InputError, match="elsewhere than in season/results; give some"):
            found(*given)
