# SPDX-License-Identifier: MIT
"""Carries out commands: a function for each handler of `imud/commands.py`, and those of
`mark`, `aim` and `capture`.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, assert_never

import msgspec

from imud.commands import COMMANDS, LENT_MAX_S, Handler
from imud.daemon.commands import Commander, arguments_of
from imud.daemon.intake import Intake
from imud.daemon.params_change import ParamsChange
from imud.daemon.params_history import HistoryFiles
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused, ImudError
from imud.net.queries import Answer
from imud.probes.aim import Aim, Target
from imud.probes.mark import mark_of
from imud.probes.timeline import host_ns

MARK = COMMANDS["mark"]
TEXT_MAX = MARK.argument("text").length_max or 0
# An older pose does not tell where the probe is now.
AGE_MAX_NS = 1_000_000_000


def mark(
    entry: ProbeEntry, parameters: Mapping[str, str], now_ns: int
) -> dict[str, Any]:
    """The mark at the pose of a probe at the host's time `now_ns`; CommandRefused if
    it is none.
    """
    value, text = _value(parameters.get("value")), parameters.get("text", "")
    is_known = not parameters.keys() - MARK.argument_names
    if not is_known or (value is None and not text) or len(text) > TEXT_MAX:
        raise CommandRefused(MARK.usage)
    scales = entry.probe.scales
    pose = _pose_now(entry, now_ns)
    return mark_of(pose, scales.params, entry.closer.sigma_m, value, text)


def _pose_now(entry: ProbeEntry, now_ns: int) -> Mapping[str, Any]:
    """Empty: there is none, or the last one is too old."""
    return entry.pose if now_ns - entry.pose_ns < AGE_MAX_NS else {}


def _value(text: str | None) -> float | None:
    if text is None:
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
    unknown = parameters.keys() - {*Target.__struct_fields__}
    given: dict[str, Any] = dict(parameters)
    try:
        q = [float(part) for part in given.pop("q", "").split(",")]
        length = math.hypot(*q)
        given["q"] = [part / length for part in q]
        target = msgspec.convert(given, Target, strict=False)
    except (ValueError, ZeroDivisionError, msgspec.ValidationError) as error:
        raise CommandRefused(AIM.usage) from error
    limits = (length, target.tolerance_deg, target.hold_s)
    if unknown or not all(map(math.isfinite, limits)) or len(target.target) > NAME_MAX:
        raise CommandRefused(AIM.usage)
    entry.aim = Aim(target)
    found: dict[str, Any] = msgspec.to_builtins(target)
    return found


def capture(entry: ProbeEntry, parameters: Mapping[str, str]) -> dict[str, Any]:
    """Keeps the present orientation of a probe as a reference. Returns it, and the name
    by which `aim` takes it up; CommandRefused if there is no pose.
    """
    if parameters:
        raise CommandRefused("capture takes no arguments")
    name = entry.probe.references.capture()
    if not entry.pose:
        raise CommandRefused(
            f"probe {entry.name} has sent no pose; start it with imud start"
        )
    keys = "q", "t_device_us", "t_ns"
    return {key: entry.pose[key] for key in keys} | {"capture": name}


Parameters = Mapping[str, str]

# Carries out a command: probe, command, parameters; ImudError with the reason if it
# is not.
Carry = Callable[[str, str, Parameters], Awaitable[Any]]


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

    async def run(self, probe: str, command: str, parameters: Parameters) -> Any:
        """Carries out a command and returns its value; ImudError if it can't be."""
        row = COMMANDS.get(command)
        # An unknown command is refused as a probe's own ones are.
        carry = self.bound(Handler.PROBE if row is None else row.handler)
        return await carry(probe, command, parameters)

    async def answer(
        self,
        probe: str,
        command: str,
        parameters: Parameters,
        answer: Answer,
        by: str,
    ) -> None:
        """Carries out a command and sends its value or the reason as the answer. What
        changes something is told to all, with who gave it.
        """
        try:
            entry = self._commander.heard(probe)
            value = await self.run(probe, command, parameters)
        except ImudError as error:
            answer(b"", str(error))
        else:
            reply = {"ok": True, "probe": probe, "command": command, "value": value}
            answer(self._encoder.encode(reply), "")
            row = COMMANDS.get(command)
            if row is not None and row.is_told:
                self._intake.tell_command(entry, command, parameters, by)

    def bound(self, handler: Handler) -> Carry:
        """The function of a handler."""
        match handler:
            case Handler.PROBE:
                return self._commander.command
            case Handler.PARAMS:
                return self._change_params
            case Handler.HISTORY:
                return self._read_history
            case Handler.AIM:
                return self._aim
            case Handler.CAPTURE:
                return self._capture
            case Handler.CLOSE:
                return self._close_path
            case Handler.CONFIGURE:
                return self._configure
            case Handler.LEND:
                return self._lend
            case Handler.MARK:
                return self._mark
        assert_never(handler)

    async def _change_params(self, probe: str, _: str, parameters: Parameters) -> Any:
        return await self._params.command(probe, parameters)

    async def _read_history(self, probe: str, _: str, parameters: Parameters) -> Any:
        probe_id = self._commander.entry_of(probe).probe.probe_id
        return await self._history.command(probe_id, parameters)

    async def _aim(self, probe: str, _: str, parameters: Parameters) -> Any:
        return aim_at(self._commander.entry_of(probe), parameters)

    async def _capture(self, probe: str, _: str, parameters: Parameters) -> Any:
        return capture(self._commander.entry_of(probe), parameters)

    async def _close_path(
        self, probe: str, command: str, parameters: Parameters
    ) -> Any:
        if parameters:  # there is no such command with arguments
            return await self._commander.command(probe, command, parameters)
        return self._intake.close_path(self._commander.entry_of(probe))

    async def _mark(self, probe: str, _: str, parameters: Parameters) -> Any:
        entry = self._commander.entry_of(probe)
        return self._intake.mark(entry, mark(entry, parameters, host_ns()))

    async def _configure(
        self, probe: str, _: str, parameters: Parameters
    ) -> dict[str, bool]:
        probe_id = self._commander.entry_of(probe).probe.probe_id
        return {"is_kept": await self._configure_probe(probe_id, parameters)}

    async def _lend(self, probe: str, command: str, parameters: Parameters) -> str:
        """The name of the port."""
        seconds, _ = arguments_of(command, parameters)
        if not 0 <= seconds <= LENT_MAX_S:
            raise CommandRefused(COMMANDS[command].usage)
        entry = self._commander.heard(probe)
        probe_id = entry.probe.probe_id
        port = self._lent.get(probe_id) if entry.port is None else entry.port.name
        if port is None or port.startswith("udp"):
            raise CommandRefused(f"{entry.name} is on no serial port")
        self._lent[probe_id] = port
        await self._lend_port(port, seconds)
        return port
