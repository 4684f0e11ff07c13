# SPDX-License-Identifier: MIT
"""One table of commands: what the daemon, the wire, the access rules, the page and the
documents know of commands is what `imud/commands.py` says.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import get_args
from unittest.mock import MagicMock, call

import pytest

from imud import cli, commands
from imud.commands import COMMANDS, PARAMETERS_MAX, Argument, Option, ProbeCommand
from imud.config import reader
from imud.daemon.command_runner import CommandRunner, Request
from imud.daemon.commands import Commander
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.daemon.params_history import HistoryFiles
from imud.errors import CommandRefused
from imud.journal.output import Journal
from imud.net import access
from imud.probes.aim import Axis, Target
from imud.roles import Role
from imud.web.users import grant_of
from imud.wire import schema

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "host" / "imud" / "web" / "site"


@pytest.fixture
def runner() -> Iterator[CommandRunner]:
    config = reader.load(None, is_logging=False)
    intake = Intake(config, Hub(), Journal(1.0, 1))
    history = HistoryFiles(None)
    yield CommandRunner(
        *(Commander(intake.registry), intake, history),
        *(lambda *_: None, lambda *_: None),
    )
    history.close()


def test_the_daemon_has_a_function_for_each_row_and_no_other(
    runner: CommandRunner,
) -> None:
    assert {*runner.own} == {row.name for row in COMMANDS.values() if row.by_daemon}
    for name in runner.own:
        asked = Request("stylus", name, {"no_such": "1"}, "it")
        with pytest.raises(CommandRefused, match=f"{name} has no parameter no_such"):
            asyncio.run(runner.run(asked))


def test_a_row_alone_is_a_command_of_the_command_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its options, its line in the help, what is sent, and its value."""
    kind = Argument("kind", "text", options=(Option("of", "which"),))
    far = Argument("far", "number", options=(Option("FAR", "how far", is_needed=True),))
    row = ProbeCommand("age", "tell its age", (kind, far), by_daemon=True)
    rows = {"age": replace(row, example="imud age stylus 3")}
    monkeypatch.setattr(commands, "COMMANDS", rows)
    client = MagicMock()
    client.__enter__().only_probe.return_value = "stylus"
    client.__enter__().command.return_value = {"value": {"age_s": 0.5}}
    monkeypatch.setattr("imud.client.Client", lambda *_: client)
    assert cli.main(["age", "stylus", "3", "--of", "poses"]) == 0
    sent = client.__enter__().command.call_args
    assert sent == call("stylus", "age", kind="poses", far="3")
    assert capsys.readouterr().out == 'stylus: age done: {"age_s": 0.5}\n'
    assert "\ncommand:\n  age " in cli.build_parser().format_help()


def test_what_a_probe_carries_out_is_what_the_wire_has() -> None:
    of_wire = {member.name.lower() for member in schema.Command}
    rows = [row for row in COMMANDS.values() if not row.by_daemon]
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
