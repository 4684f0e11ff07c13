# SPDX-License-Identifier: MIT
"""Every command with arguments that can't be: exit code 1 or 2 and one line that names
what is wrong.
"""

from __future__ import annotations

import argparse
import errno
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest

from imud.cli import build_parser, entry, main
from imud.cli.daemon import MISCONFIGURED

pytestmark = pytest.mark.sampled(5)

# Files that are none of what a command wants, by what they are.
FILES = {
    "none": None,
    "empty": b"",
    "text": b"hello\nworld\n",
    "binary": bytes(range(256)) * 40,
    "zeros": bytes(5000),
    "magic alone": b"\x89MCAP0\r\n",
    "magic and rubbish": b"\x89MCAP0\r\n" + bytes(range(256)) * 40,
    "magic at both ends": b"\x89MCAP0\r\n" * 2,
}
NUMBERS = [
    "",
    "x",
    "-1",
    "nan",
    "inf",
    "-inf",
    "1e999",
    "٣",
    "1_0x",
    "0x10",
    " ",
    "\x1b[31m",
]


@pytest.fixture
def places(tmp_path: Path) -> dict[str, Path]:
    """Paths that hold nothing of ours, by what they are."""
    found = {}
    for what, data in FILES.items():
        path = found[what] = tmp_path / f"{what.replace(' ', '-')}.x"
        if data is not None:
            path.write_bytes(data)
    found["folder"] = tmp_path / "folder"
    found["folder"].mkdir()
    found["below a file"] = found["text"] / "x"
    loop = found["loop"] = tmp_path / "loop"
    loop.symlink_to(loop)
    found["long"] = tmp_path / ("n" * 300)
    return found


def run(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code, and the line on stderr."""
    try:
        code = main(arguments)
    except SystemExit as ended:
        assert isinstance(ended.code, int), arguments
        code = ended.code
    err = capsys.readouterr().err
    lines = [line for line in err.splitlines() if line.strip()]
    assert "Traceback" not in err, (arguments, err)
    if code == 2:  # argparse puts the usage before it
        assert lines[0].startswith("usage: imud"), arguments
        lines = lines[-1:]
    if code:
        assert len(lines) == 1, (arguments, lines)
        # In words, not in those of a library.
        assert "Errno" not in lines[0], lines
        assert "codec" not in lines[0], lines
        assert lines[0].startswith("imud"), (arguments, lines)
        assert lines[0].isprintable(), (arguments, lines)
        return code, lines[0]
    return code, ""


# What reads a file: none of these is one of its own. `decode` takes any bytes for noise
# on a wire, and says so.
READERS = [
    ["decode", "FILE"],
    ["info", "FILE"],
    ["recover", "FILE"],
    ["replay", "FILE", "--speed", "max"],
    ["export", "FILE"],
    ["export", "FILE", "--to", "parquet"],
    ["card", "read", "FILE"],
    ["card", "list", "FILE"],
    ["run", "--config", "FILE"],
    ["config", "--check", "FILE"],
    ["list", "--keys", "FILE"],
    ["listen", "--keys", "FILE"],
    ["start", "--keys", "FILE"],
    ["monitor", "--keys", "FILE", "--seconds", "1"],
    ["run", "--keys", "FILE", "--listen", "tls/127.0.0.1:0", "--no-log", "/dev/none"],
    ["params", "load", "p", "FILE"],
    ["params", "show", "p", "--keys", "FILE"],
    ["keys", "add", "FILE", "viewer", "anna"],
    ["keys", "remove", "FILE", "anna"],
]
# Empty settings are settings; noise and an empty capture are no faults of a capture.
MAY_BE = {("config", "empty"), ("decode", "empty"), ("decode", "text")}
MAY_BE |= {("decode", "binary"), ("decode", "zeros")}
# A log that was cut off right at its beginning.
MAY_BE |= {
    (command, what)
    for command in ("info", "export", "recover")
    for what in FILES
    if what.startswith("magic")
}


@pytest.mark.parametrize("command", READERS, ids=" ".join)
def test_a_file_that_is_none_is_one_line_that_names_it(
    places: dict[str, Path],
    capfd: pytest.CaptureFixture[str],
    command: list[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    for what, path in places.items():
        if command[:2] == ["run", "--config"] and what == "empty":
            continue  # it runs
        arguments = [str(path) if part == "FILE" else part for part in command]
        code, line = run(arguments, capfd)
        if (command[0], what) in MAY_BE and code == 0:
            continue
        assert code in (1, 2, MISCONFIGURED), (arguments, code)
        assert path.name[:40] in line, (arguments, line)


# Commands that write a file, to an impossible place.
WRITERS = [
    ["card", "prepare", "FILE", "--size", "8G", "--yes"],
    ["install-service", "--prefix", "FILE"],
    ["keys", "init", "FILE"],
]


@pytest.mark.parametrize("command", WRITERS, ids=" ".join)
def test_where_nothing_can_be_written_is_one_line(
    places: dict[str, Path], capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    for what in ("below a file", "loop", "long"):
        path = places[what]
        code, line = run([str(path) if p == "FILE" else p for p in command], capsys)
        assert code in (1, 2), what
        assert path.name[:40] in line, line


def actions(
    parser: argparse.ArgumentParser, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    """Each command, and the parser of its arguments."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from actions(inner, (*words, name))
            return
    yield words, parser


COMMANDS = dict(actions(build_parser()))
TYPED = [
    (words, action.option_strings[0])
    for words, parser in COMMANDS.items()
    for action in parser._actions
    if action.option_strings and (action.choices or (action.type not in (None, Path)))
]


@pytest.mark.parametrize(
    ("words", "option"), TYPED, ids=[" ".join((*w, o)) for w, o in TYPED]
)
def test_an_option_that_is_no_such_number_or_word_is_named(
    words: tuple[str, ...], option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused = 0
    needed = [
        "viewer" if action.choices else "x"
        for action in COMMANDS[words]._actions
        if not action.option_strings and action.nargs in (None, "+")
    ]
    for value in NUMBERS:
        try:
            COMMANDS[words].parse_args([*needed, f"{option}={value}"])
        except SystemExit as ended:
            refused += 1
            assert ended.code == 2
            line = capsys.readouterr().err.splitlines()[-1]
            assert option in line, line
            assert "Traceback" not in line
            assert "invalid _" not in line, line  # a name of ours
            assert line.isprintable(), line
    assert refused >= 5


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_an_empty_path_is_not_the_current_folder(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for action in COMMANDS[words]._actions:
        for option in action.option_strings[-1:] if action.nargs is None else ():
            for value in ["", "--"] if action.type is Path else ["--"]:
                code, line = run([*words, f"{option}={value}"], capsys)
                assert (code, f"{option}: expected" in line) == (2, True)


REFUSED = {
    "can't use /a: Read-only": OSError(errno.EROFS, "Read-only", "/a"),
    "set TMPDIR": FileNotFoundError(errno.ENOENT, "No usable temporary directory"),
    "is not UTF-8": UnicodeEncodeError("utf-8", "\udcff", 0, 1, "surrogates"),
    "close other programs": MemoryError(),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_the_system_refuses_is_one_line_that_says_what_to_do(
    words: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entry, "build_parser", Mock(side_effect=REFUSED[words]))
    code, line = run([], capsys)
    assert code == 1
    assert words in line


@pytest.mark.parametrize(
    ("command", "code", "words"),
    [
        ("config >/dev/full", 1, "is full"),
        ("config <&- >&- 2>&-", 0, ""),
        ("info \xe9", 1, "can't read ?"),
        ("info .", 1, "name a file that is in it"),
        ("list", 1, "ulimit -n 1024"),
        ("run --config none", MISCONFIGURED, "none"),
        ("fly", 2, "there is no 'fly'"),
    ],
)
def test_as_processes_too(command: str, code: int, words: str) -> None:
    """What ends `main` is not all that ends a process."""
    shell = f"ulimit -n 16; PYTHONIOENCODING=ascii {sys.executable} -m imud {command}"
    done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True)
    *_, last = done.stderr.splitlines() or [""]
    assert last.startswith("imud: " if words else "")
    assert words in last
    assert "Traceback" not in done.stderr
    assert done.returncode == code


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_what_no_command_knows_is_exit_code_2(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for more in (["--no-such"], ["--no-such=1"], ["-z"], ["a", "b", "c", "d", "--e"]):
        code, line = run([*words, *more], capsys)
        assert code == 2
        assert line


CLIENTS = (["list"], ["listen"], ["start"], ["stop", "p"], ["tare"], ["restart"])
CLIENTS += tuple(["params", what, "p"] for what in ("show", "clear", "history"))
CLIENTS += (["params", "save", "p", "f"], ["params", "load", "p", "0bad"])
ENDPOINTS = ("", "x", "tcp/", "tcp/127.0.0.1", "tcp/[::1]:99999", "::1", "\x1b")


@pytest.mark.parametrize("command", CLIENTS, ids=" ".join)
def test_an_endpoint_or_a_prefix_that_can_t_be_is_one_line(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    for endpoint in ENDPOINTS:
        code, line = run([*command, f"--connect={endpoint}"], capsys)
        assert code == 1, endpoint
        assert "try tcp/" in line
