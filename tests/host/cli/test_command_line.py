# SPDX-License-Identifier: MIT
"""Every command has help that fits a terminal, and help is there at once."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import pytest

from imud.cli import build_parser
from programs import ran

# Modules that take long to import, and that help does not need.
HEAVY = ("asyncio", "cryptography", "mcap", "msgspec", "numpy", "rich", "zenoh")


def parsers(
    parser: argparse.ArgumentParser, words: tuple[str, ...] = ("imud",)
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from parsers(inner, (*words, name))


COMMANDS = dict(parsers(build_parser()))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_has_an_example_and_explains_each_argument(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    parser = COMMANDS[words]
    text = parser.format_help()
    assert f"example: {'sudo ' * (words[-1] == 'install-service')}imud " in text
    assert max(map(len, text.splitlines())) <= 80
    for action in parser._actions:
        is_group = isinstance(action, argparse._SubParsersAction)
        assert is_group or action.help, action


def test_an_example_is_a_command_that_there_is() -> None:
    for words, parser in COMMANDS.items():
        example = (parser.epilog or "").removeprefix("example: ").removeprefix("sudo ")
        # The probe is named before what to do with its params.
        command = example.replace(",", "").split()
        assert tuple(command[: len(words)]) == words or words == ("imud",), words


def test_help_loads_nothing_that_takes_long() -> None:
    code = (
        "import sys; from imud.cli import build_parser; build_parser().format_help();"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = ran(sys.executable, "-c", code, check=True)
    assert done.stdout == "[]\n"
