# SPDX-License-Identifier: MIT
"""Carries out commands: a function for each row `by_daemon` of `imud/commands.py`."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from imud.commands import COMMANDS, LENT_MAX_S
from imud.daemon.commands import Commander, arguments_of, refuse_unknown
from imud.daemon.intake import Intake
from imud.daemon.params_change import ParamsChange
from imud.daemon.params_history import HistoryFiles
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused, ImudError
from imud.net.queries import Answer
from imud.params.value import Params
from imud.probes.aim import Aim, Target
from imud.probes.mark import MarkBook, mark_of
from imud.probes.sensors import missing_magnetometer
from imud.probes.timeline import host_ns

MARK = COMMANDS["mark"]
BUTTON = "button"  # who gave a command by a gesture
# What gestures of a button ask for, besides the stream and strokes.
ORDERS = {
    "origin": ("tare", {"what": "all"}),
    "undo": ("tare", {"what": "undo"}),
    "path": ("close", {}),
    "mark": ("mark", {"text": "by its button"}),
}
WORDS = ("unit", "text")
# An older pose does not tell where the probe is now.
AGE_MAX_NS = 1_000_000_000


def mark(
    entry: ProbeEntry, parameters: Mapping[str, str], now_ns: int, marks: MarkBook
) -> dict[str, Any]:
    """The mark at the pose of a probe at the host's time `now_ns`, or an earlier one
    as it is from now on; CommandRefused if it is none.
    """
    before: Mapping[str, Any] = {"value": None, "unit": "", "text": ""}
    mark_id, withdraw = parameters.get("id"), parameters.get("withdraw")
    if mark_id is not None:
        found = marks.find(entry.probe.probe_id, mark_id)
        if found is None:
            raise CommandRefused(f"{entry.name} has no mark {mark_id[:40]}")
        before = found
    if parameters.keys() == {"id", "withdraw"} and withdraw == "1":
        return {**before, "state": "withdrawn"}
    noted = {key: parameters.get(key, before[key]) for key in ("value", "unit", "text")}
    if isinstance(noted["value"], str):
        noted["value"] = _value(noted["value"])
    is_short = all(len(noted[k]) <= (MARK.argument(k).length_max or 0) for k in WORDS)
    if withdraw or not is_short or (noted["value"] is None and not noted["text"]):
        raise CommandRefused(MARK.usage)
    if mark_id is not None:
        return {**before, **noted, "state": "corrected"}
    pose = _pose_now(entry, now_ns)
    return mark_of(pose, entry.probe.scales.params, entry.closer.sigma_m, noted)


def _pose_now(entry: ProbeEntry, now_ns: int) -> Mapping[str, Any]:
    """Empty: there is none, or the last one is too old."""
    return entry.pose if now_ns - entry.pose_ns < AGE_MAX_NS else {}


def _value(text: str) -> float | None:
    if not text:
        return None
    try:
        value = float(text)
    except ValueError as error:
        raise CommandRefused(MARK.usage) from error
    if not math.isfinite(value):
        raise CommandRefused(MARK.usage)
    return value


AIM = COMMANDS["aim"]
NAME_MAX = AIM.argument("target").length_max or 0


def aim_at(entry: ProbeEntry, parameters: Mapping[str, str]) -> dict[str, Any] | None:
    """Sets or removes the target of a probe, and returns it; CommandRefused if the
    parameters are wrong.
    """
    if parameters == {"off": "1"}:
        entry.aim = None
        return None
    given: dict[str, Any] = dict(parameters)
    try:
        q = [float(part) for part in given.pop("q", "").split(",")]
        length = math.hypot(*q)
        given["q"] = [part / length for part in q]
        target = msgspec.convert(given, Target, strict=False)
    except (ValueError, ZeroDivisionError, msgspec.ValidationError) as error:
        raise CommandRefused(AIM.usage) from error
    limits = (length, target.tolerance_deg, target.hold_s)
    if (
        "off" in parameters
        or not all(map(math.isfinite, limits))
        or len(target.target) > NAME_MAX
    ):
        raise CommandRefused(AIM.usage)
    entry.aim = Aim(target)
    found: dict[str, Any] = msgspec.to_builtins(target)
    return found


def capture(entry: ProbeEntry) -> dict[str, Any]:
    """Keeps the present orientation of a probe as a reference. Returns it, and the name
    by which `aim` takes it up; CommandRefused if there is no pose.
    """
    name = entry.probe.references.capture()
    if not entry.pose:
        raise CommandRefused(
            f"probe {entry.name} has sent no pose; start it with imud start"
        )
    keys = "q", "t_device_us", "t_ns"
    return {key: entry.pose[key] for key in keys} | {"capture": name}


def _params_of(entry: ProbeEntry) -> Params:
    if entry.probe.params is None:
        raise CommandRefused(f"the params of {entry.name} are not known yet; retry")
    return Params.decode(entry.probe.params)


Parameters = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Request:
    """A command to the probe of that name, and who gives it."""

    probe: str
    command: str
    parameters: Parameters
    by: str


class CommandRunner:
    """`configure` changes the settings of the probe of an id; `lend` closes the port of
    that name for a number of seconds.
    """

    def __init__(
        self,
        commander: Commander,
        intake: Intake,
        history: HistoryFiles,
        configure: Callable[[str, Parameters], Awaitable[bool]],
        lend: Callable[[str, float], Awaitable[None]],
    ) -> None:
        self._commander = commander
        self._intake = intake
        self._params = ParamsChange(commander)
        self._history = history
        self._configure_probe = configure
        self._lend_port = lend
        self._lent: dict[str, str] = {}  # by probe's id: its port
        self._encoder = msgspec.json.Encoder()
        # Each returns the value, or raises an ImudError with the reason.
        self.own: Mapping[str, Callable[[Request], Awaitable[Any]]] = {
            "params": self._change_params,
            "params_history": self._read_history,
            "aim": self._aim,
            "capture": self._capture,
            "mark": self._mark,
            "close": self._close_path,
            "configure": self._configure,
            "magnetometer": self._use_magnetometer,
            "lend": self._lend,
        }

    async def run(self, request: Request) -> Any:
        """Carries out a command and returns its value; ImudError if it can't be."""
        row = COMMANDS.get(request.command)
        if row is not None and row.by_daemon:
            refuse_unknown(row.name, request.parameters)
            return await self.own[row.name](request)
        # An unknown command is refused as a probe's own ones are.
        return await self._commander.command(
            request.probe, request.command, request.parameters
        )

    async def answer(self, request: Request, answer: Answer) -> None:
        """Carries out a command and sends its value or the reason as the answer. What
        changes something is told to all, with who gave it.
        """
        probe, command = request.probe, request.command
        try:
            entry = self._commander.heard(probe)
            value = await self.run(request)
        except ImudError as error:
            answer(b"", str(error))
        else:
            reply = {"ok": True, "probe": probe, "command": command, "value": value}
            answer(self._encoder.encode(reply), "")
            row = COMMANDS.get(command)
            if row is not None and row.is_told:
                parameters, by = request.parameters, request.by
                self._intake.tell_command(entry, command, parameters, by)

    async def by_button(self, entry: ProbeEntry, action: str) -> None:
        """Carries out what a gesture of its button asks for, which is told to all; also
        that it was refused.
        """
        is_on = entry.counters.get("state") == "streaming"
        command, words = ORDERS.get(action, ("stop" if is_on else "start", {}))
        refused = None
        try:
            if action == "origin" and "starting" in entry.pose.get("flags", ()):
                raise CommandRefused("wait until it has found level and north")
            await self.run(Request(entry.name, command, words, BUTTON))
        except ImudError as error:
            refused = str(error)
        self._intake.tell_command(entry, command, words, BUTTON, refused)

    def _entry(self, request: Request) -> ProbeEntry:
        return self._commander.entry_of(request.probe)

    async def _change_params(self, request: Request) -> Any:
        return await self._params.command(request.probe, request.parameters)

    async def _read_history(self, request: Request) -> Any:
        probe_id = self._entry(request).probe.probe_id
        return await self._history.command(probe_id, request.parameters)

    async def _aim(self, request: Request) -> Any:
        return aim_at(self._entry(request), request.parameters)

    async def _capture(self, request: Request) -> Any:
        return capture(self._entry(request))

    async def _close_path(self, request: Request) -> Any:
        return self._intake.close_path(self._entry(request))

    async def _mark(self, request: Request) -> Any:
        entry = self._entry(request)
        marks = self._intake.marks
        made = mark(entry, request.parameters, host_ns(), marks)
        return self._intake.mark(entry, made)

    async def _configure(self, request: Request) -> dict[str, bool | str]:
        entry = self._entry(request)
        button = request.parameters.get("button")
        kept = await self._configure_probe(entry.probe.probe_id, request.parameters)
        if button is not None:
            await self._set_button(entry, "tell" if button else "stream")
        why = ""
        if name := request.parameters.get("rename"):
            try:
                await self._replace(entry, "name", {"text": name})
            except ImudError as error:
                why = str(error)
        return {"is_kept": kept, "why": why}

    async def _set_button(self, entry: ProbeEntry, does: str) -> None:
        await self._replace(entry, "options", {"button_does": does})

    async def _replace(
        self, entry: ProbeEntry, record: str, values: Mapping[str, str]
    ) -> None:
        """Changes these values of a record of a probe's params; ImudError."""
        params = _params_of(entry)
        before = params.plain(record) or {}
        records = params.replaced(record, {**before, **values})
        await self._params.command(entry.name, {"records": records.encode().hex()})

    async def _use_magnetometer(self, request: Request) -> None:
        arguments_of(request.command, request.parameters)
        entry, is_on = self._entry(request), request.parameters["use"] == "on"
        if is_on is False and (why := missing_magnetometer(entry.probe.hello)):
            raise CommandRefused(f"probe {entry.name}: {why}")
        params = _params_of(entry).with_magnetometer(is_on=is_on)
        words = {"records": params.encode().hex()}
        await self._params.command(entry.name, words)

    async def _lend(self, request: Request) -> str:
        """The name of the port."""
        seconds, _ = arguments_of(request.command, request.parameters)
        if not 0 <= seconds <= LENT_MAX_S:
            raise CommandRefused(COMMANDS[request.command].usage)
        entry = self._commander.heard(request.probe)
        probe_id = entry.probe.probe_id
        port = self._lent.get(probe_id) if entry.port is None else entry.port.name
        if port is None or port.startswith("udp"):
            raise CommandRefused(f"{entry.name} is on no serial port")
        self._lent[probe_id] = port
        await self._lend_port(port, seconds)
        return port
