# SPDX-License-Identifier: MIT
"""One table of commands: what the daemon, the wire, the access rules, the page and the
documents know of commands is what `imud/commands.py` says.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from imud import commands
from imud.commands import COMMANDS, PARAMETERS_MAX, Argument, Handler, ProbeCommand
from imud.config import reader
from imud.daemon.command_runner import CommandRunner
from imud.daemon.commands import Commander
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.daemon.params_history import HistoryFiles
from imud.journal.output import Journal
from imud.net import access
from imud.probes.aim import Axis, Target
from imud.roles import Role
from imud.web.users import grant_of
from imud.wire import schema

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "host" / "imud" / "web" / "site"


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


def row_of(command: ProbeCommand) -> str:
    arguments = "; ".join(map(described, command.arguments))
    who = f"who reads `{command.topic}`" if command.topic else ", ".join(command.roles)
    return f"| `{command.name}` | {arguments} | {who} | {command.help} |"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_document_has_each_command(name: str) -> None:
    text = (ROOT / "docs" / "pose.md").read_text("utf-8")
    assert row_of(COMMANDS[name]) in text.splitlines()


def test_the_document_has_no_other_command() -> None:
    text = (ROOT / "docs" / "pose.md").read_text("utf-8")
    _, _, section = text.partition("\n## Commands\n")
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == [*COMMANDS]


def test_each_row_has_a_handler_that_the_daemon_binds() -> None:
    config = reader.load(None, is_logging=False)
    intake = Intake(config, Hub(), Journal(1.0, 1))
    history = HistoryFiles(None)
    try:
        runner = CommandRunner(
            *(Commander(intake.registry), intake, history),
            *(lambda *_: None, lambda *_: None),
        )
        bound = {handler: runner.bound(handler) for handler in Handler}
    finally:
        history.close()
    assert len(set(bound.values())) == len(Handler)
    assert {row.handler for row in COMMANDS.values()} == set(Handler)


def test_what_a_probe_carries_out_is_what_the_wire_has() -> None:
    of_wire = {member.name.lower() for member in schema.Command}
    rows = [row for row in COMMANDS.values() if row.handler is Handler.PROBE]
    assert {row.name for row in rows} == of_wire - commands.PARAMS_STEPS
    assert of_wire > commands.PARAMS_STEPS
    for row in rows:
        assert len(row.arguments) <= 2  # numbers in a message
        assert {each.type for each in row.arguments} <= {"choice", "list", "integer"}
        assert bool(row.needs) == bool(row.arguments)


def test_an_aim_has_the_arguments_of_a_target() -> None:
    aim = COMMANDS["aim"]
    assert aim.argument_names == {*Target.__struct_fields__, "off"}
    assert tuple(aim.argument("axis").choices) == get_args(Axis)


def test_every_command_fits_what_a_browser_may_send() -> None:
    assert max(len(row.arguments) for row in COMMANDS.values()) <= PARAMETERS_MAX


def test_the_page_sends_only_commands_of_the_table() -> None:
    called = re.compile(
        r"""(?:\.ask\(\s*[\w.]+,\s*|_button\(\s*"[^"]*",\s*|\[)"(\w+)",\s*\{\s*(\w*)"""
    )
    found = {
        (name, argument)
        for path in SITE.rglob("*.js")
        for name, argument in called.findall(path.read_text("utf-8"))
    }
    assert {name for name, _ in found} >= {"start", "tare", "rate", "aim", "configure"}
    for name, argument in found:
        assert not argument or argument in COMMANDS[name].argument_names


def test_a_row_alone_admits_a_role(monkeypatch: pytest.MonkeyPatch) -> None:
    def may_ask() -> list[str]:
        rules = access.rules({"v": "viewer"}, "imud", has_certificates=False)["rules"]
        (asked,) = [each for each in rules if each["id"] == "viewer ingress ask"]
        return [key for key in asked["key_exprs"] if "/cmd/" in key]

    assert may_ask() == []
    stop = replace(COMMANDS["stop"], roles=("viewer", "operator"))
    for module in (commands, access):
        monkeypatch.setattr(module, "COMMANDS", {**COMMANDS, "stop": stop})
    assert may_ask() == ["imud/*/cmd/stop", "imud/@id/*/cmd/stop"]
    assert access.who_may("cmd/stop") == ["viewer", "operator", "daemon"]
    assert access.who_may("cmd/start") == ["operator", "daemon"]
    grant = grant_of("viewer")
    assert grant.may_send("stop")
    assert not grant.may_send("start")


@pytest.mark.parametrize("role", ["viewer", "operator", "recorder"])
def test_who_may_command_may_send_all_of_them(role: Role) -> None:
    grant = grant_of(role)
    assert grant.commands == frozenset(COMMANDS if role == "operator" else ())
    assert grant.may_send("no such command") == (role == "operator")
