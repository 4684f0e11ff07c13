# SPDX-License-Identifier: MIT
"""No file of settings is a fault: each that can't be is told by file, line and key."""

from __future__ import annotations

import os
import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import inspect

from imud.cli import main
from imud.cli.daemon import MISCONFIGURED
from imud.config.reader import as_toml
from imud.config.settings import Config
from length import choose
from programs import ran

pytestmark = pytest.mark.sampled(5)

SEED = 20_260_102
PROBE = "probes.00112233445566aa"

# One of each kind that TOML has, and what is at the edge of it.
VALUES = [
    *("true", "false", "0", "-1", "1", "3", "1.5", "-0.0", "nan", "-inf", "inf"),
    *("1e999", str(2**63), str(-(2**63) - 1), "9" * 4000, "0xffffffff", "0o17"),
    *(
        "''",
        '"a"',
        '"\\u0000"',
        '"\\n"',
        '"\\u202e"',
        "'''\nx\n'''",
        "'" + "x" * 5000 + "'",
    ),
    *("[]", "[[]]", "[1, 2]", "['a', 'a']", "[true, 1, 'x']", "[{a = 1}]", "[[[1]]]"),
    *(
        "{}",
        "{a = 1}",
        "{find = true}",
        "2026-01-02",
        "12:00:00",
        "2026-01-02T03:04:05Z",
    ),
]


def keys(kind: type[msgspec.Struct], table: str = "") -> Iterator[tuple[str, str, Any]]:
    """Table, key and type of each that there is."""
    for field in msgspec.structs.fields(kind):
        info = inspect.type_info(field.type)
        info = info.type if isinstance(info, inspect.Metadata) else info
        if isinstance(info, inspect.StructType):
            yield from keys(info.cls, field.name)
        elif isinstance(info, inspect.DictType):
            assert isinstance(info.value_type, inspect.StructType)
            yield from keys(info.value_type.cls, PROBE)
        else:
            yield table, field.name, info


KEYS = list(keys(Config))
NAMES = [f"{table}.{key}" if table else key for table, key, _ in KEYS]


def check(file: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """The lines of `imud config --check`, each of them sound."""
    status = main(["config", "--check", str(file)])
    out, err = capsys.readouterr()
    lines = err.splitlines()
    assert status == (1 if lines else 0)
    assert bool(out) != bool(lines)
    for line in lines:
        assert line.startswith("imud: "), line
        assert str(file) in line, line
        assert line.isprintable(), line
        assert len(line) < 600, line
    return lines


def toml_of(table: str, key: str, value: str) -> str:
    head = f"[{table}]\n" if table else ""
    return f"# a comment\n{head}{key} = {value}\n"


@pytest.mark.long
@pytest.mark.parametrize(("table", "key", "info"), KEYS, ids=NAMES)
def test_each_key_takes_what_it_can_and_names_itself_else(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    table: str,
    key: str,
    info: inspect.Type,
) -> None:
    file = tmp_path / "imud.toml"
    line_number = 3 if table else 2
    refused = 0
    first = KEYS.index((table, key, info)) % 6
    values = choose(everyday=VALUES[first::6], long=VALUES)
    for value in values:
        file.write_text(toml_of(table, key, value))
        lines = check(file, capsys)
        refused += bool(lines)
        for line in lines:
            if "is not TOML" in line:
                continue  # 4000 digits: the parser's own bound
            if f"[{table}] {key}: " in line or f" {key}: " in line:
                assert f"imud.toml:{line_number}: " in line, (value, line)
            else:  # it contradicts another key of its section
                assert f"imud.toml:2: [{table}] " in line, (value, line)
    # Each key is of one type, so that most of these can't be it.
    assert refused > len(values) // 2


BOUNDED = [
    (table, key, info)
    for table, key, info in KEYS
    for each in [info]
    if isinstance(each, inspect.IntType | inspect.FloatType)
]


@pytest.mark.parametrize(
    ("table", "key", "info"), BOUNDED, ids=[f"{t}.{k}" for t, k, _ in BOUNDED]
)
def test_a_bound_is_where_it_is_said_to_be(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    table: str,
    key: str,
    info: inspect.IntType | inspect.FloatType,
) -> None:
    file = tmp_path / "imud.toml"
    step = 1 if isinstance(info, inspect.IntType) else 1e-9

    def is_taken(value: float) -> bool:
        file.write_text(toml_of(table, key, repr(value)))
        return not check(file, capsys)

    assert info.ge is not None or info.gt is not None
    if info.ge is not None:
        assert is_taken(info.ge)
        assert not is_taken(info.ge - step)
    if info.gt is not None:
        assert not is_taken(info.gt)
        assert is_taken(info.gt + step)
    if info.le is not None:
        assert is_taken(info.le)
        assert not is_taken(info.le + (1 if step == 1 else 1e-6))


TEXTS = {
    "a key twice": "twin = true\ntwin = true\n",
    "a section twice": "[log]\ndir = 'a'\n[log]\ndir = 'b'\n",
    "a section that was a value": "log = 1\n[log]\ndir = 'a'\n",
    "a section many times": "[[log]]\ndir = 'a'\n",
    "many of a probe": "[[probes.00112233445566aa]]\nname = 'a'\n",
    "a section in a value": "[log.dir]\na = 1\n",
    "a section in a probe": f"[{PROBE}.log]\na = 1\n",
    "an inline section with a mistake": "log = {dir = 'a', rotate_mb = 0}\n",
    "a dotted key": "log.rotate_mb.x = 1\n",
    "an empty key": "'' = 1\n",
    "a key with an escape": '"a\\u001b[31m\\nerror" = 1\n',
    "a probe with an escape": '[probes."\\u001b[31m"]\nname = "a"\n',
    "a long key": "x" * 5000 + " = 1\n",
    "a long name": f"[{PROBE}]\nname = '{'a/' * 3000}'\n",
    "a long prefix": f"[zenoh]\nprefix = '{'a b' * 3000}'\n",
    "a long endpoint": f"[zenoh]\nlisten = ['tcp/{'9' * 5000}:1']\n",
    "a long address": f"[metrics]\nlisten = '{'9' * 5000}:1'\n",
    "no value": "twin =\n",
    "no quotes": "[log]\ndir = logs\n",
    "half a string": "[log]\ndir = 'logs\n",
    "half a list": "[ports]\nnamed = ['a',\n",
    "a wrong escape": '[log]\ndir = "\\q"\n',
    "a lone surrogate": '[log]\ndir = "\\ud800"\n',
    "carriage returns": "twin = true\rlog = 1\r",
    "a byte order mark": "\ufefftwin = 1\n",
    "a line of 100,000 signs": "# " + "x" * 100_000 + "\ntwin = 1\n",
    "nested lists": "[ports]\nnamed = " + "[" * 5000 + "]" * 5000,
    "nested keys": ".".join("a" * 3000) + " = 1\n",
    "another's format": '{"log": {"dir": "a"}}',
    "ini": "[log]\ndir: a\n",
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_what_is_no_settings_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    file = tmp_path / "imud.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    assert check(file, capsys)


def test_windows_lines_and_nothing_at_all_are_settings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "imud.toml"
    for text in ("", "\n\n", "# only words", "twin = true\r\n[log]\r\ndir = 'a'\r\n"):
        file.write_bytes(text.encode())
        assert not check(file, capsys)


def mutated(chance: random.Random, text: str) -> str:
    """A file as an editor, a cat on the keyboard or another version may change it."""
    lines = text.splitlines()
    for _ in range(chance.randint(1, 6)):
        at = chance.randrange(len(lines))
        kind = chance.randrange(9)
        key, equals, _ = lines[at].partition(" = ")
        is_key = bool(equals) and not key.startswith("#")
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines.insert(chance.randrange(len(lines)), lines[at])
        elif kind <= 4 and is_key:
            lines[at] = f"{key} = {chance.choice(VALUES)}"
        elif kind == 5 and is_key:
            lines[at] = f"{key}{chance.choice('abc_.-')} = 1"
        elif kind == 6:
            place = chance.randrange(len(lines[at]) + 1)
            sign = chance.choice("\"'[]{}=#.,\\\0\x1b\n\t0e-_é\u2028")
            lines[at] = lines[at][:place] + sign + lines[at][place:]
        elif kind == 7:
            lines[at] = lines[at][: chance.randrange(len(lines[at]) + 1)]
        else:
            lines[at] = lines[at].removeprefix("# ")
        lines = lines or [""]
    return "\n".join(lines)


@pytest.mark.long
def test_no_mutation_of_a_whole_file_is_a_fault(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chance = random.Random(SEED)  # noqa: S311 - the same files on every run
    whole = as_toml(Config()) + f"\n[{PROBE}]\nname = 'stylus'\npose_rate = 100\n"
    file = tmp_path / "imud.toml"
    refused = placed = 0
    cases = choose(everyday=50, long=600)
    for _ in range(cases):
        file.write_text(mutated(chance, whole))
        lines = check(file, capsys)
        refused += bool(lines)
        placed += all(
            re.search(r"imud\.toml:\d+: |at line \d+", line) for line in lines
        )
    assert 0.4 * cases < refused < cases
    # The end of a document has no line; all else has one.
    assert placed > 0.88 * cases


@pytest.mark.parametrize("data", [b"\x7fELF\x02\x01\x01\0", b"\xff\xfe\0", bytes(999)])
def test_a_binary_file_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], data: bytes
) -> None:
    file = tmp_path / "imud.toml"
    file.write_bytes(data)
    (line,) = check(file, capsys)
    assert "is not TOML" in line or "is not a text file" in line


def test_what_can_not_be_read_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for name in ("none.toml", "a" * 300, "loop", "x/y"):
        (line,) = check(tmp_path / name, capsys)
        assert "can't read" in line
    (line,) = check(tmp_path, capsys)
    assert "Is a directory" in line
    os.mkfifo(tmp_path / "pipe")
    closed = tmp_path / "closed.toml"
    closed.write_text("")
    closed.chmod(0)
    if os.access(closed, os.R_OK):
        return  # root reads all
    (line,) = check(closed, capsys)
    assert "Permission denied" in line


@pytest.mark.parametrize("command", ["config --check", "run --config"])
@pytest.mark.parametrize(
    "text", ["twin = 1", "x = [", "\0", "[log]\nrotate_mb = 0\nfoo = 1"]
)
def test_the_process_ends_with_its_code_and_one_line(
    tmp_path: Path, command: str, text: str
) -> None:
    file = tmp_path / "imud.toml"
    file.write_text(text)
    done = ran(sys.executable, "-m", "imud", *command.split(), file, cwd=tmp_path)
    assert done.returncode == (1 if "check" in command else MISCONFIGURED)
    lines = done.stderr.splitlines()
    assert len(lines) == (2 if "foo" in text and "check" in command else 1)
    assert all(line.startswith("imud: ") and str(file) in line for line in lines)
