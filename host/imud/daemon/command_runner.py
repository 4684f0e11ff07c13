# SPDX-License-Identifier: MIT
"""Carries out commands: binds a function to each handler of `imud/commands.py`."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any, assert_never

import msgspec

from imud.commands import COMMANDS, LENT_MAX_S, Handler
from imud.daemon.aiming import aim_at, capture
from imud.daemon.commands import Commander, arguments_of
from imud.daemon.intake import Intake
from imud.daemon.marking import mark
from imud.daemon.params_change import ParamsChange
from imud.daemon.params_history import HistoryFiles
from imud.errors import CommandRefused, ImudError
from imud.net.queries import Answer
from imud.probes.timeline import host_ns

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
        configure: Callable[[str, Parameters], bool],
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
        return {"is_kept": self._configure_probe(probe_id, parameters)}

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
