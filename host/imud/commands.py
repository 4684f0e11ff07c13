# SPDX-License-Identifier: MIT
"""The commands to a probe, each as one row: arguments, roles, help, handler, and what
the command line prints of its value.

The command line with its help, the page, the access rules, the daemon's errors and the
table in docs/pose.md (`protocol/generate.py`) read it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from imud.roles import Role
from imud.wire import schema

Type = Literal["choice", "list", "integer", "number", "numbers", "text", "hex"]

STREAMS = {"pose": 0, "raw": 1}
FILTERS = {each.name.lower(): each.value for each in schema.Filter if each}
HISTORY = "params_history"
LENT_MAX_S = 300  # a program that borrows a port and dies keeps it no longer
PARAMETERS_MAX = 8  # of one command from the page; no row has more arguments


# What the command line prints: the probe, the arguments that were given, the value.
Says = Callable[[str, Mapping[str, str], Any], str]


@dataclass(frozen=True, slots=True)
class Option:
    """`--NAME` on the command line, or in capitals a word after the probe. It gives its
    argument `value`, or without one what is typed, or one of the choices.
    """

    name: str
    help: str
    value: str | None = None
    is_needed: bool = False  # of a word

    @property
    def is_word(self) -> bool:
        return self.name.isupper()


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a command, which is text on the network."""

    name: str
    type: Type
    choices: Mapping[str, int] = field(default_factory=dict)  # word: number on the wire
    unit: str = ""
    limits: str = ""  # as the documents state them
    length_max: int | None = None  # characters
    is_optional: bool = False  # left out, a probe gets 0
    options: tuple[Option, ...] = ()


@dataclass(frozen=True, slots=True)
class ProbeCommand:
    """A command. With an `example` the command line has it, under the name there."""

    name: str
    help: str
    arguments: tuple[Argument, ...] = ()
    needs: str = ""  # the words for wrong arguments: NAME needs ...
    roles: tuple[Role, ...] = ("operator",)
    # A function in `daemon/command_runner.py` carries it out; else the probe itself.
    by_daemon: bool = False
    example: str = ""
    typed_help: str = ""  # in place of `help` where the command line offers less
    details: str = ""  # more for its own help on the command line
    says: Says | None = None  # None: "done", and the daemon's value if there is one
    # A query of this topic with parameters is this command, so who may read the topic
    # may send it; it is not among the commands that an error lists.
    topic: str = ""
    is_told: bool = False  # to all, with who gave it: it changes what others see

    @property
    def typed(self) -> str:
        """Its name on the command line; empty if it has none."""
        return self.example.removeprefix("imud ").partition(" ")[0]

    @property
    def argument_names(self) -> set[str]:
        return {each.name for each in self.arguments}

    @property
    def usage(self) -> str:
        """The error message for wrong arguments."""
        return f"{self.name} needs {self.needs}"

    def argument(self, name: str) -> Argument:
        return next(each for each in self.arguments if each.name == name)

    def words(self, probe: str, given: Mapping[str, str], value: Any) -> str:
        """What the command line prints once it is carried out."""
        if self.says is not None:
            return self.says(probe, given, value)
        told = f": {json.dumps(value)}" if self.by_daemon and value is not None else ""
        return f"{probe}: {self.name} done{told}"


def _say_mark(probe: str, _: Mapping[str, str], value: Any) -> str:
    place, error = value["position_m"], value["position_sigma_m"]
    where = value["no_position"]
    if place is not None:
        mm = " ".join(f"{1000.0 * each:.1f}" for each in place)
        sure = "" if error is None else f" +-{1000.0 * error:.1f}"
        where = f"tip at {mm}{sure} mm"
    done = "marked" if value["state"] == "new" else value["state"]
    return f"{probe}: {done}; {where}; its id is {value['id']}"


def _say_name(probe: str, given: Mapping[str, str], value: Any) -> str:
    said = f"{probe} is now called {given['rename']}"
    if not value["is_kept"]:
        said += (
            "\nuntil the daemon restarts or reloads its configuration, which has "
            "another name for it"
        )
    if value["why"]:
        said += f"\nother hosts don't know that name: {value['why']}"
    return said


_SWITCH = {"0": 0, "1": 1}

_ROWS = (
    ProbeCommand("start", "make a probe stream", example="imud start", is_told=True),
    ProbeCommand(
        "stop", "make a probe stop streaming", example="imud stop", is_told=True
    ),
    ProbeCommand(
        "tare",
        "make a probe's current orientation the origin",
        (
            Argument(
                "what",
                "choice",
                {"all": 0, "heading": 1, "undo": 2},
                is_optional=True,
                options=(
                    Option(
                        "heading",
                        "only the heading becomes 0; pitch and roll still refer to the "
                        "vertical",
                        "heading",
                    ),
                    Option("undo", "go back to east, north and up", "undo"),
                ),
            ),
        ),
        needs="what=all, heading or undo",
        example="imud tare --heading",
        is_told=True,
    ),
    ProbeCommand(
        "restart",
        "restart a probe's calibration at rest, filter and origin",
        (
            Argument(
                "filter",
                "choice",
                FILTERS,
                is_optional=True,
                options=(
                    Option(
                        "filter",
                        "filter to run from now on (default: the current one)",
                    ),
                ),
            ),
            Argument(
                "forget",
                "choice",
                _SWITCH,
                is_optional=True,
                options=(
                    Option(
                        "forget",
                        "also delete the probe's stored own magnetic field",
                        "1",
                    ),
                ),
            ),
        ),
        needs=f"filter={', '.join(FILTERS)}, or nothing; forget=0 or 1",
        example="imud restart --filter madgwick",
        details="Lay the probe still first.",
        is_told=True,
    ),
    ProbeCommand(
        "rate",
        "set how often a stream is sent",
        (
            Argument("stream", "choice", STREAMS),
            Argument("hz", "integer", unit="Hz", limits="1 to the sample rate"),
        ),
        needs="stream=pose or raw, and hz=a number",
        is_told=True,
    ),
    ProbeCommand(
        "fields",
        "select the streams that are sent",
        (Argument("streams", "list", STREAMS, limits="at least one"),),
        needs="streams=pose,raw or one of them",
        is_told=True,
    ),
    ProbeCommand("hello", "make a probe send its hello"),
    ProbeCommand("reset", "restart the processor of a probe", is_told=True),
    ProbeCommand("time", "ask a probe for its time, as the daemon does periodically"),
    ProbeCommand("params_tell", "make a probe send its params"),
    ProbeCommand(
        "params",
        "activate params, all records or none",
        (
            Argument("records", "hex"),
            Argument("probe", "text", limits="the id of the probe", is_optional=True),
            Argument("force", "choice", _SWITCH, is_optional=True),
        ),
        needs="records=hexadecimal digits; imud params load sends a file",
        by_daemon=True,
        is_told=True,
    ),
    ProbeCommand(
        HISTORY,
        "list all params that were active, or return those with a digest",
        (
            Argument("history", "choice", {"1": 1}, is_optional=True),
            Argument(
                "digest",
                "hex",
                limits="its first digits, at most 8",
                is_optional=True,
            ),
        ),
        by_daemon=True,
        topic="params",
    ),
    ProbeCommand(
        "aim",
        "set or clear the target orientation of a probe",
        (
            Argument("q", "numbers", limits="W,X,Y,Z: world_from_body"),
            Argument(
                "axis", "choice", {"x": 0, "y": 1, "z": 2, "all": 3}, is_optional=True
            ),
            Argument("tolerance_deg", "number", unit="degrees", is_optional=True),
            Argument("hold_s", "number", unit="s", is_optional=True),
            Argument("target", "text", length_max=60, is_optional=True),
            Argument(
                "capture",
                "text",
                limits="the name given to `capture`",
                is_optional=True,
            ),
            Argument("off", "choice", {"1": 1}, limits="alone", is_optional=True),
        ),
        needs="q=W,X,Y,Z with world_from_body, and may have axis=x, y, z or all, "
        "tolerance_deg, hold_s, target=NAME and capture=NAME; or off=1",
        by_daemon=True,
    ),
    ProbeCommand(
        "capture",
        "keep a probe's current orientation as a target to aim at",
        by_daemon=True,
    ),
    ProbeCommand(
        "mark",
        "put a value or a note into the log, with the tip's current position; correct "
        "one, or take it back",
        (
            Argument(
                "value",
                "number",
                is_optional=True,
                options=(Option("VALUE", "a number measured there"),),
            ),
            Argument(
                "unit",
                "text",
                length_max=20,
                is_optional=True,
                options=(Option("unit", "unit of the value, such as N"),),
            ),
            Argument(
                "text",
                "text",
                length_max=200,
                is_optional=True,
                options=(Option("note", "text of at most 200 characters"),),
            ),
            Argument(
                "id",
                "text",
                limits="of an earlier mark",
                is_optional=True,
                options=(Option("id", "change this mark instead"),),
            ),
            Argument(
                "withdraw",
                "choice",
                {"1": 1},
                is_optional=True,
                options=(Option("withdraw", "take back the mark of --id", "1"),),
            ),
        ),
        needs="value=NUMBER or text=TEXT of at most 200 characters, or both, and may "
        "have unit=TEXT of at most 20; id=ID and what changes, or id=ID and withdraw=1",
        by_daemon=True,
        example="imud mark stylus 0.42 --note 'second press'",
        details="The mark is published on imud/PROBE/mark with the current pose and "
        "its errors, logged, shown on the page, and exported by imud export.",
        says=_say_mark,
    ),
    ProbeCommand("close", "close the path of a probe's strokes", by_daemon=True),
    ProbeCommand(
        "configure",
        "rename a probe or choose what its button does, permanently; or start or stop "
        "its log until the daemon reloads its configuration",
        (
            Argument(
                "rename",
                "text",
                is_optional=True,
                options=(
                    Option(
                        "NAME", "the new name, without / and spaces", is_needed=True
                    ),
                ),
            ),
            Argument("log", "choice", {"on": 1, "off": 0}, is_optional=True),
            Argument(
                "button",
                "text",
                limits="what its click, double click, hold and long hold do",
                is_optional=True,
            ),
        ),
        needs="rename=NAME, log=on or off, or button=CLICK,DOUBLE,HOLD,LONG of none, "
        "stream, stroke, path, origin, undo and mark",
        by_daemon=True,
        example="imud name 00112233445566aa stylus",
        typed_help="give a probe a name",
        details="The daemon keeps the name, on any port, and so does the probe, for "
        "other hosts. Subscribers find it under its new name: imud/stylus/pose.",
        says=_say_name,
        is_told=True,
    ),
    ProbeCommand(
        "magnetometer",
        "use a probe's magnetometer, or not",
        (
            Argument(
                "use",
                "choice",
                {"off": 0, "on": 1},
                options=(Option("USE", "on or off", is_needed=True),),
            ),
        ),
        needs="use=on or off",
        by_daemon=True,
        example="imud magnetometer stylus off",
        details="Without it a probe has no heading, only its change. Poses have the "
        "flag mag_off. Its calibration is kept. The filter restarts: lay it still.",
        is_told=True,
    ),
    ProbeCommand(
        "lend",
        "close a probe's port for that many seconds, for another program on this "
        "machine",
        (
            Argument(
                "seconds",
                "integer",
                unit="s",
                limits=f"0, which ends it, to {LENT_MAX_S}",
            ),
        ),
        needs=f"seconds=0 to {LENT_MAX_S}",
        by_daemon=True,
    ),
)

COMMANDS: Mapping[str, ProbeCommand] = {each.name: each for each in _ROWS}

# The other commands of the wire. One word or one step of a change of params: alone they
# only make another client's change fail.
PARAMS_STEPS = frozenset({"params_write", "params_apply"})
