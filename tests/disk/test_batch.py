import errno
import json
import os
import signal
import subprocess
import sys
import threading

import pytest

from photonormal.disk import PARTIAL, InUse, at_once, in_use, recover, refuse_taken, write
from photonormal.types import InputError

OLD = {"a.txt": "old a", "deep/b.txt": "old b", "gone.txt": "old"}
NEW = {"a.txt": "new a", "deep/b.txt": "new b", "deep/er/c.txt": "new c", "d.txt": "new d"}
MINE = {"letter.txt": "mine", "deep/letter.txt": "mine", "e.txt": "mine"}
CALLS = ("mkdir", "rmdir", "rename", "unlink", "open", "write", "fsync", "ftruncate")


def content(folder):
    return {str(p.relative_to(folder)): p.read_text() for p in sorted(folder.rglob("*")) if p.is_file()}


def place(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def put(folder):
    with at_once(folder) as batch:
        for name, text in NEW.items():
            batch.write(name, text.encode())
        batch.remove = ["gone.txt", "absent.txt"]


class Ended(BaseException):
    """The process ends here: nothing that comes later has an effect."""


class Faults:
    """Every changing call of the operating system counts; from number `first` to `last` they raise `error`."""

    def __init__(self, monkeypatch, error, first=10**9, last=10**9):
        self.count, self.opened, self.error, self.first, self.last = 0, [], error, first, last
        for name in CALLS:
            monkeypatch.setattr(os, name, self.counted(getattr(os, name)))
        monkeypatch.setattr(os, "close", self.closed(os.close))

    def closed(self, close):
        def f(file):
            self.opened.remove(file)
            close(file)

        return f

    def end(self):
        """What the system does when the process has ended."""
        for file in self.opened:
            os.close(file)

    def counted(self, call):
        def f(*arguments, **options):
            self.count += 1
            if self.first <= self.count <= self.last:
                raise self.error
            if call.__name__ == "fsync":  # takes long, and nothing here cuts the power
                return None
            result = call(*arguments, **options)
            if call.__name__ == "open":
                self.opened.append(result)
            return result

        return f


def calls_of_a_batch(tmp_path):
    """How many calls change the disk while a batch goes well."""
    place(tmp_path / "count", OLD | MINE)
    with pytest.MonkeyPatch.context() as monkeypatch:
        faults = Faults(monkeypatch, None)
        put(tmp_path / "count")
    return faults.count


def test_files_appear_at_once_and_others_stay(tmp_path):
    place(tmp_path, OLD | MINE)
    with at_once(tmp_path) as batch:
        for name, text in NEW.items():
            batch.write(name, text.encode())
            assert {k: v for k, v in content(tmp_path).items() if PARTIAL not in k} == OLD | MINE
        batch.remove = ["gone.txt"]
    assert content(tmp_path) == NEW | MINE
    assert not (tmp_path / PARTIAL).exists()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EIO])
def test_an_error_of_any_call_leaves_the_old_or_the_new_files_whole(tmp_path, number):
    for k in range(1, calls_of_a_batch(tmp_path) + 1):
        folder = tmp_path / str(k)
        place(folder, OLD | MINE)
        with pytest.MonkeyPatch.context() as monkeypatch:
            Faults(monkeypatch, OSError(number, os.strerror(number)), k, k)
            try:
                put(folder)
                expected = NEW
            except InputError as error:
                assert "Nothing was changed." in str(error) and "\n" not in str(error), k
                expected = OLD
        recover(folder)  # what could not be removed
        assert content(folder) == expected | MINE, k
        assert not (folder / PARTIAL).exists(), k


def test_a_disk_that_stays_broken_is_put_right_later(tmp_path):
    for k in range(1, calls_of_a_batch(tmp_path) + 1):
        folder = tmp_path / str(k)
        place(folder, OLD | MINE)
        with pytest.MonkeyPatch.context() as monkeypatch:
            Faults(monkeypatch, OSError(errno.EIO, "Input/output error"), k)
            try:
                put(folder)
                expected = NEW
            except InputError as error:
                expected = OLD
                untouched = {n: t for n, t in content(folder).items() if PARTIAL not in n} == OLD | MINE
                assert ("Nothing was changed." in str(error)) == untouched, k
        recover(folder)
        assert content(folder) == expected | MINE, k


def test_a_process_that_ends_anywhere_leaves_what_can_be_put_right(tmp_path, caplog):
    for k in range(1, calls_of_a_batch(tmp_path) + 1):
        folder = tmp_path / str(k)
        place(folder, OLD | MINE)
        with pytest.MonkeyPatch.context() as monkeypatch:
            faults = Faults(monkeypatch, Ended(), k)
            with pytest.raises(Ended):
                put(folder)
        faults.end()
        caplog.clear()
        recover(folder)
        told = "\n".join(caplog.messages)
        assert content(folder) in (OLD | MINE, NEW | MINE), k
        assert not (folder / PARTIAL).exists(), k
        assert ("are back" in told) <= (content(folder) == OLD | MINE)
    assert content(folder) == NEW | MINE  # which only the removal of the journal's folder was left to do


def test_undoing_that_ends_anywhere_can_be_done_again(tmp_path):
    ended = calls_of_a_batch(tmp_path) - 24  # among the moves
    for k in range(1, 20):
        folder = tmp_path / str(k)
        place(folder, OLD | MINE)
        for first, job in ((ended, put), (k, recover)):
            with pytest.MonkeyPatch.context() as monkeypatch:
                faults = Faults(monkeypatch, Ended(), first)
                try:
                    job(folder)
                except Ended:
                    faults.end()
        if k == 1:
            there = {n for n in content(folder) if PARTIAL not in n}
            assert there != set(OLD | MINE) and there != set(NEW | MINE)  # the moves had begun
        recover(folder)
        assert content(folder) == OLD | MINE, k


def test_a_file_that_took_the_place_of_one_being_undone_stays(tmp_path):
    place(tmp_path, {"a.txt": "old a"})
    with pytest.MonkeyPatch.context() as monkeypatch:
        rename, faults = os.rename, Faults(monkeypatch, Ended())

        def last(path, to):
            if faults.first == 0:
                raise Ended
            rename(path, to)
            if str(to) == str(tmp_path / "b.txt"):
                faults.first = 0
                raise Ended

        monkeypatch.setattr(os, "rename", last)
        with pytest.raises(Ended), at_once(tmp_path) as batch:
            batch.write("a.txt", b"new a")
            batch.write("b.txt", b"new b")
    faults.end()
    (tmp_path / "b.txt").unlink()
    (tmp_path / "b.txt").write_text("mine, written after the kill")
    recover(tmp_path)
    assert content(tmp_path) == {"a.txt": "old a", "b.txt": "mine, written after the kill"}


@pytest.mark.parametrize("name", ["../thesis.txt", "{mine}/thesis.txt", "link/thesis.txt", "", 7])
def test_a_journal_of_somebody_else_reaches_nothing_outside(tmp_path, name):
    mine, folder = tmp_path / "mine", tmp_path / "downloaded"
    place(mine, {"thesis.txt": "mine"})
    place(folder, {f"{PARTIAL}/{place}/x": "theirs" for place in ("new", "old")})
    for where in (folder, folder / PARTIAL / "new", folder / PARTIAL / "old"):
        (where / "link").symlink_to(mine)
    name = name.replace("{mine}", str(mine)) if isinstance(name, str) else name
    entries = ({"written by": "photonormal"}, {"file": name}, {"old": [name], "new": {}, "folders": []}, {"done": True})
    (folder / PARTIAL / "journal").write_text("".join(json.dumps(e) + "\n" for e in entries))
    before = content(tmp_path)
    for job in (recover, put):
        with pytest.raises(InputError, match="not left by a run of photonormal"):
            job(folder)
        assert content(tmp_path) == before


@pytest.mark.parametrize(
    "text", ["[]", "{", "[" * 100_000, '{"old": 1}', '{"old": []}', '{"new": []}', '{"file": null}']
)
def test_a_journal_that_is_none_is_told_in_one_line(tmp_path, text):
    place(tmp_path, {f"{PARTIAL}/journal": '{"written by": "photonormal"}\n' + text + "\n"})
    with pytest.raises(InputError, match="look at its content"):
        recover(tmp_path)


def test_the_next_run_tells_what_it_clears_up(tmp_path, caplog):
    code = (
        f"import os; from photonormal.disk import at_once\nwith at_once(__import__('pathlib').Path({str(tmp_path)!r}))"
    )
    subprocess.run([sys.executable, "-c", code + " as b: b.write('a.txt', b'half'); os.kill(os.getpid(), 9)"])
    assert (tmp_path / PARTIAL / "new" / "a.txt").exists()
    write(tmp_path / "b.txt", b"new")
    assert content(tmp_path) == {"b.txt": "new"}
    assert "a run that was killed left files in" in caplog.text


def test_a_second_process_is_refused_or_waits(tmp_path):
    code = "import sys; from pathlib import Path; from photonormal.disk import at_once\n"
    code += "with at_once(Path(sys.argv[1]), float(sys.argv[2])) as b: b.write('b.txt', b'theirs')"
    with at_once(tmp_path) as batch:
        batch.write("a.txt", b"ours")
        done = subprocess.run([sys.executable, "-c", code, tmp_path, "0"], capture_output=True, text=True)
        assert (
            "InUse" in done.stderr
            and issubclass(InUse, InputError)
            and "is being written by another photonormal" in done.stderr
        )
        waits = subprocess.Popen([sys.executable, "-c", code, tmp_path, "60"])
    assert waits.wait() == 0
    assert content(tmp_path) == {"a.txt": "ours", "b.txt": "theirs"}


def test_ctrl_c_among_the_moves_waits_for_their_end(tmp_path, monkeypatch):
    place(tmp_path, OLD | MINE)
    rename = os.rename
    monkeypatch.setattr(os, "rename", lambda *a: (os.kill(os.getpid(), 2), rename(*a)))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            put(tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
    monkeypatch.undo()
    assert content(tmp_path) == NEW | MINE and not (tmp_path / PARTIAL).exists()


def test_a_thread_that_is_still_writing_leaves_nothing_after_a_second_ctrl_c(tmp_path):
    started, ended, outcome = threading.Event(), threading.Event(), []

    def late():
        started.set()
        ended.wait()
        try:
            batch.write("late.txt", b"half")
        except RuntimeError as error:
            outcome.append(str(error))

    with pytest.raises(KeyboardInterrupt), at_once(tmp_path) as batch:
        batch.write("a.txt", b"half")
        thread = threading.Thread(target=late)
        thread.start()
        started.wait()
        raise KeyboardInterrupt
    ended.set()
    thread.join()
    assert outcome == [f"{tmp_path} is no longer written"] and list(tmp_path.iterdir()) == []


def test_targets_are_refused_before_the_work(tmp_path):
    place(tmp_path, {"photo.png": "p", "folder/x": "x"})
    refuse_taken([tmp_path / "new.png"], overwrite=False)
    refuse_taken([tmp_path / "photo.png"], overwrite=True)
    with pytest.raises(InputError, match="add --overwrite"):
        refuse_taken([tmp_path / "photo.png"], overwrite=False)
    with pytest.raises(InputError, match="is read here"):
        refuse_taken([tmp_path / "folder" / ".." / "photo.png"], overwrite=True, reads=[tmp_path / "photo.png"])
    with pytest.raises(InputError, match="is a folder"):
        refuse_taken([tmp_path / "folder"], overwrite=True)
    with pytest.raises(InputError, match="too long"):
        refuse_taken([tmp_path / ("a" * 300)], overwrite=True)


def test_one_file_needs_its_folder(tmp_path):
    with pytest.raises(InputError, match="create it first"):
        write(tmp_path / "absent" / "a.txt", b"")
    write(tmp_path / os.fsdecode(b"caf\xe9.txt"), b"bytes")
    assert os.listdir(os.fsencode(tmp_path)) == [b"caf\xe9.txt"]


def test_processes_that_write_into_one_folder_wait_for_each_other(tmp_path):
    code = (
        "import sys; from pathlib import Path; from photonormal.disk import at_once\n"
        "for i in range(40):\n"
        "    with at_once(Path(sys.argv[1])) as batch:\n"
        "        batch.write(f'{sys.argv[2]}-{i}', b'x')\n"
    )
    running = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), str(k)]) for k in range(3)]
    assert [process.wait() for process in running] == [0, 0, 0]
    assert len(content(tmp_path)) == 120


def test_a_folder_is_in_use_while_something_is_written_there(tmp_path):
    assert not in_use(tmp_path)
    with at_once(tmp_path) as batch:
        batch.write("a.txt", b"a")
        assert in_use(tmp_path)
    assert not in_use(tmp_path)
