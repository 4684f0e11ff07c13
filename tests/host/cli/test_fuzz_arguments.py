# SPDX-License-Identifier: MIT
"""Every command with arguments that can't be: exit code 1 or 2 and one line that names
what is wrong.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fakes import free_endpoint
from imud.cli import build_parser, main
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
    capsys: pytest.CaptureFixture[str],
    command: list[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    for what, path in places.items():
        if command[:2] == ["run", "--config"] and what == "empty":
            continue  # it runs
        arguments = [str(path) if part == "FILE" else part for part in command]
        code, line = run(arguments, capsys)
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
ENDPOINTS = (
    "",
    "x",
    "tcp",
    "tcp/",
    "tcp/127.0.0.1",
    "tcp/127.0.0.1:99999",
    "udp",
    "\x1b",
)


@pytest.mark.parametrize("command", CLIENTS, ids=" ".join)
def test_an_endpoint_or_a_prefix_that_can_t_be_is_one_line(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    for endpoint in ENDPOINTS:
        code, _ = run([*command, f"--connect={endpoint}"], capsys)
        assert code == 1, endpoint


@pytest.mark.parametrize("endpoint", ENDPOINTS)
def test_a_daemon_that_can_t_listen_says_so_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], endpoint: str
) -> None:
    code, _ = run(
        ["run", "/dev/none", "--log", str(tmp_path), f"--listen={endpoint}"], capsys
    )
    # What is no endpoint at all will not become one by waiting.
    assert code in (1, MISCONFIGURED)


def test_as_processes_too(tmp_path: Path) -> None:
    """What ends `main` is not all that ends a process."""
    for command in itertools.chain(
        (["decode", "none"], ["info", "none"], ["list", "--connect", free_endpoint()]),
        (["run", "--config", "none"], ["replay", "none"], ["fly"]),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "imud", *command],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
        )
        codes = {"fly": 2, "run": MISCONFIGURED}
        assert done.returncode == codes.get(command[0], 1), command
        *_, last = done.stderr.splitlines()
        assert last.startswith("imud: "), command
        assert "Traceback" not in done.stderr
