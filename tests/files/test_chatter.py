"""What libraries print while they decode is heard by the decoding that printed it, and by nobody else."""

import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

from photonormal.files.chatter import heard


def test_descriptor_2_and_pythons_streams_are_heard_and_kept_from_the_terminal(capfd):
    def decode():
        os.write(2, b"corrupt\n")
        print("said")
        print("wrong", file=sys.stderr)
        return 3

    assert heard(decode) == (3, "corrupt\nsaid\nwrong\n")
    assert heard(lambda: 4) == (4, "")
    assert capfd.readouterr() == ("", "")
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"


def test_an_error_comes_back_with_what_was_printed():
    def decode():
        os.write(2, b"bad block\n")
        raise ValueError("no picture")

    error, printed = heard(decode)
    assert isinstance(error, ValueError) and printed == "bad block\n"


def test_threads_hear_only_themselves():
    """Half of them print, all at the same time."""
    barrier = threading.Barrier(4, timeout=20)
    first = set()

    def decode(j):
        if j not in first:
            first.add(j)
            barrier.wait()
        if j % 2:
            os.write(2, b"%d\n" % j)
        return j

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda j: heard(lambda: decode(j)), range(4)))
    assert found == [(0, ""), (1, "1\n"), (2, ""), (3, "3\n")]


def test_another_thread_prints_as_always(capfd):
    inside, done = threading.Event(), threading.Event()

    def decode():
        inside.set()
        done.wait(20)

    with ThreadPoolExecutor(1) as pool:
        decoding = pool.submit(heard, decode)
        inside.wait(20)
        print("warning", file=sys.stderr)
        done.set()
        decoding.result()
    assert capfd.readouterr().err == "warning\n"
