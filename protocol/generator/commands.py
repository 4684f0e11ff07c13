# SPDX-License-Identifier: MIT
"""The table of commands in docs/pose.md."""

from __future__ import annotations

from generator.tables import filled, table
from imud.commands import COMMANDS, Argument, ProbeCommand


def document(text: str) -> str:
    """The text of docs/pose.md with its table replaced."""
    rows = [row_of(each) for each in COMMANDS.values()]
    lines = table("| command | arguments | role | does |", rows)
    return filled("docs/pose.md", text, "commands", lines)


def described(argument: Argument) -> str:
    """An argument in the table of the document."""
    values = argument.limits or argument.unit
    if argument.limits and argument.unit:
        values = f"{argument.limits}, {argument.unit}"
    if argument.choices:
        words = [f"`{word}`" for word in argument.choices]
        join = " or " if argument.type == "choice" else ", "
        values = "; ".join(filter(None, (join.join(words), argument.limits)))
    if argument.length_max is not None:
        values = f"at most {argument.length_max} characters"
    text = f"`{argument.name}`: {values or argument.type}"
    return f"[{text}]" if argument.is_optional else text


def row_of(command: ProbeCommand) -> list[str]:
    arguments = "; ".join(map(described, command.arguments))
    who = f"who reads `{command.topic}`" if command.topic else ", ".join(command.roles)
    does = f"{command.help}: `{command.example}`" if command.example else command.help
    return [f"`{command.name}`", arguments, who, does]
