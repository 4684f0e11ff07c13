# SPDX-License-Identifier: MIT
"""What documents quote exists: imud's commands with their options, make's targets,
files and settings. So do the commands that imud's own messages name.
"""

from __future__ import annotations

import argparse
import ast
import itertools
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from benchmarks.__main__ import BENCHES
from imud.cli import build_parser
from imud.config.settings import Config
from imud.config.toml import mistakes

ROOT = Path(__file__).resolve().parents[2]

DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *(ROOT / "hardware" / "README.md", ROOT / "protocol" / "PROTOCOL.md"),
    *sorted((ROOT / "docs").glob("*.md")),
]
SOURCES = sorted((ROOT / "host" / "imud").rglob("*.py"))
ROOTS = (ROOT, ROOT / "tests")  # docs/limits.md leaves out tests/
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):.*## ", MAKEFILE, re.M))
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```$", re.M | re.S)
# A command at the beginning of a line or after another one, up to what ends it.
COMMAND = re.compile(
    r"(?:^|[|;:] |\$ |sudo |bin/|\('|then )(imud|make) ((?:(?!, )[^#|;:&'`\n])*)", re.M
)
PATH = re.compile(
    r"(?:benchmarks|docs|examples|firmware|hardware|host|packages|protocol|sim|tests"
    r"|tools|\.ci)/[\w./*-]*(?:\.\w+|/)"
)
SETTING = re.compile(r"\[([\w.]+)\] (\w+)(?: = (.+))?")
PARSER = build_parser()


def faults(text: str) -> list[str]:
    """Everything that a document quotes and that does not exist."""
    found: list[str] = []
    for kind, block in BLOCK.findall(text):
        found += command_faults(
            re.sub(r"^ +", "", block.replace("\\\n", " "), flags=re.M)
        )
        found += settings_faults(block) if kind == "toml" else ()
    for span in re.findall(r"`([^`\n]+)`", BLOCK.sub("", text)):
        found += command_faults(span)
        path = PATH.fullmatch(span.partition(":")[0])
        if path and not any(any(at.glob(path[0].rstrip("/"))) for at in ROOTS):
            found.append(f"{span}: there is no such file")
        if setting := SETTING.fullmatch(span):
            table, key, value = setting.groups()
            found += settings_faults(f"[{table}]\n{key} = {value or '[[[]]]'}", value)
    return found


def command_faults(text: str, known: Sequence[str] = ()) -> Iterator[str]:
    """`known`: words that make it a command, where others are prose."""
    for program, rest in COMMAND.findall(text):
        # [--option VALUE] may be left out.
        words = re.sub(r"[][()\"\\]|\.\.\.", " ", rest).split()
        check = imud_fault if program == "imud" else make_fault
        if known and (program != "imud" or words[:1] == [] or words[0] not in known):
            continue
        if fault := check([word.rstrip(".,") for word in words]):
            yield f"{program} {rest.strip()}: {fault}"


def inner(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def imud_fault(words: list[str]) -> str | None:
    """The first word that is no command or option; one in capitals stands for any."""
    parser = PARSER
    while words and (commands := inner(parser)) and not words[0].startswith("-"):
        if words[0].isupper():
            early = [word for word in words if word in commands]
            return f"{early[0]} comes before {words[0]}" if early else None
        if words[0] not in commands:
            return f"there is no command {words[0]}"
        parser, words = commands[words[0]], words[1:]
    options = dict(parser._option_string_actions)
    for each in inner(parser).values():  # left out, as BOARD in imud sim --stream
        options |= each._option_string_actions
    for word, value in itertools.pairwise([*words, ""]):
        name = word.partition("=")[0]
        if re.fullmatch(r"--?[a-z][a-z-]*", name):
            if name not in options:
                return f"there is no option {name}"
            choices = options[name].choices
            if choices and value[:1].islower() and value not in choices:
                return f"{name} takes no {value}"
    return None


def make_fault(words: list[str]) -> str | None:
    if not words or words[0].startswith("-"):  # the Makefile of another project
        return None
    for word in words:
        name, is_variable, value = word.partition("=")
        if is_variable and not re.search(rf"\$\({name}[:)]|[( ]{name},", MAKEFILE):
            return f"there is no variable {name}"
        if name == "WHAT" and value.islower() and value not in BENCHES:
            return f"there is no benchmark {value}"
    return None if words[0] in TARGETS else f"there is no target {words[0]}"


def settings_faults(text: str, value: str | None = "") -> Iterator[str]:
    """Mistakes in a part of imud.toml; if `value` is None, in the names of keys."""
    table = tomllib.loads(text)
    if table.keys() <= set(Config.__struct_fields__):  # else it is another file
        for mistake in mistakes(table, Config):
            if value is not None or "no such key" in mistake.words:
                yield f"{'.'.join(mistake.path)}: {mistake.words}"


def message_faults(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr | ast.Constant):
            parts = getattr(node, "values", [node])
            texts = [
                str(p.value) if isinstance(p, ast.Constant) else "X" for p in parts
            ]
            yield from command_faults("".join(texts), list(inner(PARSER)))


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_what_a_document_quotes_exists(path: Path) -> None:
    found = faults(path.read_text("utf-8"))
    assert not found, "\n".join(found)


def test_commands_that_messages_name_exist() -> None:
    for path in SOURCES:
        found = list(message_faults(path.read_text("utf-8")))
        assert not found, f"{path}: {found}"


def cell_fault(cell: str) -> str | None:
    """What a cell of the table of faults lacks: a test with its words in the name."""
    tests: list[str] = []
    if re.match(r"none: \w+", cell):
        return None
    for clause in cell.split("; "):
        if match := re.fullmatch(r"`([\w/]+)`: (.*)", clause):
            file = match[1] if "/" in match[1] else f"core/test_{match[1]}"
            path, clause = ROOT / "tests" / f"{file}.py", match[2]
            tests = re.findall(r"^def test_(\w+)", path.read_text("utf-8"), re.M)
        words = re.sub("[- ]", "_", clause)
        if not words or not any(f"_{words}_" in f"_{test}_" for test in tests):
            return f"there is no test of this: {cell}"
    return None


def test_each_fault_of_each_device_has_its_test() -> None:
    text = (ROOT / "docs" / "decisions" / "boards.md").read_text("utf-8")
    table = text.split("| device | nonsense |")[1].split("\n\n")[0]
    rows = [row.strip("| ").split(" | ") for row in table.split("\n")[2:]]
    assert {len(row) for row in rows} == {6}
    assert [x for row in rows for cell in row[1:] if (x := cell_fault(cell))] == []
    assert cell_fault("`battery`: a dip; its rust")
    assert cell_fault("-")


def test_each_target_of_make_is_explained() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    assert {name for name in TARGETS - {"help"} if f"`make {name}" not in text} == set()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("`imud prams show stylus`", "there is no command prams"),
        ("`imud params PROBE load FILE`", "load comes before PROBE"),
        ("```\n  $ imud run --twinn\n```", "there is no option --twinn"),
        ("`imud sim pico --wire uart [--streem]`", "there is no option --streem"),
        ("`sudo imud flash PORT --by usb`", "--by takes no usb"),
        ("`make tset`", "there is no target tset"),
        ("`make bench WHAT=nan`", "there is no benchmark nan"),
        ("```\nmake demo BORD=nano\n```", "there is no variable BORD"),
        ("`host/imud/clii/sim.py: add`", "there is no such file"),
        ("`[log] keep_gb`", "there is no such key"),
        ('```toml\n[log]\nrotate_mb = "many"\n```', "is not a whole number"),
    ],
)
def test_what_does_not_exist_is_told(text: str, told: str) -> None:
    (fault,) = faults(text)
    assert told in fault


def test_a_message_with_a_wrong_command_is_told() -> None:
    (fault,) = message_faults('f"imud params {probe} load DIGEST restores one"')
    assert fault.endswith("load comes before X")
