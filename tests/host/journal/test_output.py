# SPDX-License-Identifier: MIT
"""The daemon's lines when nobody reads them."""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fakes import PATIENCE_S
from imud.journal.output import JournalStream, journal_on_stderr
from imud.machine import system


@contextmanager
def full_pipe() -> Iterator[tuple[int, int]]:
    """Both ends of a pipe that takes no byte more."""
    source, end = os.pipe()
    with os.fdopen(end, "wb", closefd=False) as pipe:
        system.shorten_pipe(pipe)
    os.set_blocking(end, False)
    try:
        while True:
            os.write(end, b"." * 1024)
    except BlockingIOError:
        os.set_blocking(end, True)
    try:
        yield source, end
    finally:
        os.close(source)
        os.close(end)


def read(source: int, until: str) -> str:
    found = ""
    while until not in found:
        found += os.read(source, 65536).decode()
    return found.lstrip(".")


def test_lines_that_nobody_reads_wait_and_the_oldest_of_many_are_counted() -> None:
    with full_pipe() as (source, end):
        stream = JournalStream(end, lines_max=4)
        for number in range(10):
            assert stream.write(f"line {number}\n") == 7
        assert stream.dropped in (5, 6)  # the thread may have one in hand
        assert not stream.drain(0.0)
        text = read(source, "line 9\n")
        assert stream.drain(PATIENCE_S)
    told = [int(words[1]) for words in map(str.split, text.splitlines()) if words[4:]]
    assert sum(told) == stream.dropped
    assert text.count("line ") == 10 - stream.dropped
    assert text.endswith("line 6\nline 7\nline 8\nline 9\n")


def test_a_stderr_that_takes_nothing_costs_its_lines_alone() -> None:
    stream = JournalStream(os.open("/dev/full", os.O_WRONLY))
    stream.write("one\ntwo\n")
    stream.write("three\n")
    assert stream.drain(PATIENCE_S)
    assert stream.dropped == 3
    os.close(stream.fileno())


def test_all_that_python_says_meanwhile_goes_the_same_way_and_the_end_does_not_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Lines of other libraries, warnings and tracebacks of threads use sys.stderr."""
    with full_pipe() as (_, end), os.fdopen(end, "w", closefd=False) as plain:
        monkeypatch.setattr(sys, "stderr", plain)
        monkeypatch.setattr("imud.journal.output.LAST_S", 0.0)
        with journal_on_stderr("info") as stream:
            logging.getLogger("imud").info("found")
            print("a library's", file=sys.stderr)  # noqa: T201 - as a library would
        assert sys.stderr is stream  # and the process ends without its last words


def test_a_stderr_that_is_read_gets_its_lines_in_their_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal"
    with path.open("w", encoding="ascii") as plain:
        monkeypatch.setattr(sys, "stderr", plain)
        with journal_on_stderr("info"):
            logging.getLogger("imud").warning("probe \N{GREEK SMALL LETTER MU}\x1b")
        assert sys.stderr is plain
    assert path.read_text()[8:] == " warning: probe \\u03bc?\n"
