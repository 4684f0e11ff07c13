# SPDX-License-Identifier: MIT
"""The parser of the command line: commands in groups, and what was probably meant."""

from __future__ import annotations

import argparse
import difflib
import shutil
import textwrap
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, NoReturn

# Names of the argument that is a command, and of a board.
COMMANDS = ("COMMAND", "BOARD")


def plain(text: str) -> str:
    """Replaces control characters: a message may repeat what was typed or read."""
    return "".join(c if c.isprintable() else "?" for c in text)


class Parser(argparse.ArgumentParser):
    """Names what was probably meant, and shows its help where a command is missing."""

    def error(self, message: str) -> NoReturn:
        if any(message.endswith(f"are required: {name}") for name in COMMANDS):
            self.print_help()
            self.exit()
        super().error(plain(message))

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        """argparse makes a list of the value `--`, Path the current folder of ''."""
        is_list = arg_strings == ["--"] and action.nargs is None
        if is_list or (action.type is Path and "" in arg_strings):
            raise argparse.ArgumentError(action, "expected a value, not an empty one")
        return super()._get_values(action, arg_strings)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """A command or another choice that does not exist."""
        choices = action.choices
        if choices is None or value in choices:
            return
        known = [str(each) for each in choices]
        if (near := _near(str(value), known)) is not None:
            raise argparse.ArgumentError(
                action, f"there is no {value!r}; did you mean {near}?"
            )
        raise argparse.ArgumentError(
            action, f"there is no {value!r}, only {', '.join(known)}"
        )

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse has it, but a misspelt option or a probe before the command is an
        error that names the right form.
        """
        words = [*args] if args is not None else []
        commands = self._commands()
        if len(words) > 1 and words[0] not in commands and words[1] in commands:
            first = f"{self.prog} {words[1]} {words[0]}"
            self.error(f"put the command first: {first}")
        found, extras = super().parse_known_args(args, namespace)
        options = [text for text in extras if text.startswith("-")]
        known = [each for each in self._option_string_actions if each.startswith("--")]
        for option in options:
            word = option.partition("=")[0]
            if (near := _near(word, known)) is not None:
                self.error(f"there is no option {word}; did you mean {near}?")
        return found, extras

    def _commands(self) -> Collection[str]:
        found = (each for each in self._actions if each.metavar in COMMANDS)
        choices = next((action.choices for action in found if action.choices), ())
        return [str(each) for each in choices]


class GroupedParser(Parser):
    """A parser whose commands are listed in groups: a title, and their names."""

    commands: argparse._SubParsersAction[argparse.ArgumentParser] | None = None

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.groups: dict[str, list[str]] = {}

    def format_help(self) -> str:
        """The help with the commands under the titles of `groups`."""
        if self.commands is None:
            return super().format_help()
        texts = {each.dest: each.help for each in self.commands._choices_actions}
        width = min(shutil.get_terminal_size().columns, 90) - 2
        column = 4 + max(map(len, texts))
        lines = [self.format_usage(), *textwrap.wrap(self.description or "", width), ""]
        for title, names in self.groups.items():
            lines.append(f"{title}:")
            for name in names:
                wrapped = textwrap.wrap(texts[name] or "", width - column)
                lines.append(f"  {name:{column - 2}}{wrapped[0]}")
                lines += [f"{'':{column}}{line}" for line in wrapped[1:]]
            lines.append("")
        formatter = self._get_formatter()
        formatter.start_section("options")
        formatter.add_arguments(self._optionals._group_actions)
        formatter.end_section()
        formatter.add_text(self.epilog)
        return "\n".join([*lines, formatter.format_help()])


def _near(word: str, known: Sequence[str]) -> str | None:
    found = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return found[0] if found else None
