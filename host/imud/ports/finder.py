# SPDX-License-Identifier: MIT
"""Finds the ports that probes are on: those that are named, and any that comes.

A port found is opened, listened to and, where nothing of ours speaks, given back at
once; it is tried again after pauses that grow, so that others can have it.
"""

from __future__ import annotations

import asyncio
import contextlib
import fnmatch
import logging
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from serial.tools import list_ports

from imud.config.settings import Ports, port_and_baud
from imud.errors import PortLost, PortNotFound
from imud.journal.speaker import Speaker
from imud.ports.baud import Memory
from imud.ports.port import Listener, Port

# The ports are listed this often, 0.9 ms each, and at once when /dev has changed.
LIST_S = 1.0
LOOK_S = 0.1
DEVICES = Path("/dev")

# Until a port that is none of ours is tried again: doubled each time.
PAUSE_S = 5.0
PAUSE_MAX_S = 300.0

# A port that has just come is not everybody's until udev is done with it.
REFUSED_S = 0.2

logger = logging.getLogger("imud")


class Listed(Protocol):
    """What is known of a port without opening it: of pyserial's ListPortInfo."""

    device: str
    hwid: str
    vid: int | None


@dataclass(slots=True)
class Pause:
    """Of a port that is there and not open."""

    until_s: float
    next_s: float


def is_candidate(port: Listed, ignore: Iterable[str]) -> bool:
    """USB and Bluetooth; a port of the machine's own may drive who knows what."""
    is_bluetooth = Path(port.device).name.startswith("rfcomm")
    if port.vid is None and not is_bluetooth:
        return False
    names = (port.device, port.hwid)
    return not any(
        fnmatch.fnmatchcase(name, pattern) or same_port(port.device, pattern)
        for pattern in ignore
        for name in names
    )


def same_port(a: str, b: str) -> bool:
    """/dev/serial/by-id/... is a link to a port."""
    return os.path.realpath(a) == os.path.realpath(b)


class Finder:
    """Keeps a Port for each port that is named or may have a probe on it."""

    def __init__(
        self,
        settings: Ports,
        probes: Listener,
        speaker: Speaker,
        *,
        listed: Callable[[], Iterable[Listed]] = list_ports.comports,
    ) -> None:
        self._settings = settings
        self._probes = probes
        self._speaker = speaker
        self._listed = listed
        self._memory = Memory()
        self._ports: dict[str, Port] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._pauses: dict[str, Pause] = {}
        self._changed = asyncio.Event()
        self._dev_ns = 0

    def __iter__(self) -> Iterator[Port]:
        return iter(list(self._ports.values()))

    def configure(self, settings: Ports) -> None:
        """Ports that are named no longer are closed; their probes are then gone."""
        self._settings = settings
        self._changed.set()

    def check(self, t_ns: int) -> None:
        """Once a second."""
        for port in self:
            port.check(t_ns)

    async def run(self) -> None:
        """Until it is cancelled."""
        try:
            async with asyncio.TaskGroup() as self._group:
                while True:
                    self._serve_named()
                    if self._settings.find:
                        await self._serve_found()
                    await self._wait()
        except ExceptionGroup as faults:
            raise faults.exceptions[0] from None

    async def _wait(self) -> None:
        """Until there may be something to do."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + LIST_S
        while (left_s := until_s - loop.time()) > 0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), min(LOOK_S, left_s))
            if self._changed.is_set() or self._is_dev_changed():
                break
        self._changed.clear()

    def _is_dev_changed(self) -> bool:
        """2 us: a port that comes or goes is an entry of the folder."""
        before = self._dev_ns
        self._dev_ns = DEVICES.stat().st_mtime_ns
        return self._dev_ns != before

    def _serve_named(self) -> None:
        settings = self._settings
        named = dict(map(port_and_baud, settings.named))
        for name, port in list(self._ports.items()):
            if port.is_named and name not in named:
                self._tasks[name].cancel()
        for name, baud in named.items():
            if name not in self._tasks:
                rates = (baud,) if baud else settings.rates
                self._serve(name, self._port(name, rates, is_named=True))

    async def _serve_found(self) -> None:
        now_s = asyncio.get_running_loop().time()
        # In a thread: a driver may take its time to say what it is.
        listed = await asyncio.to_thread(lambda: list(self._listed()))
        found = {p.device: p for p in listed if is_candidate(p, self._settings.ignore)}
        for name in self._pauses.keys() - found.keys():
            del self._pauses[name]  # unplugged: what comes next may be another
        for name, port in found.items():
            pause = self._pauses.get(name)
            if pause is not None and now_s < pause.until_s:
                continue
            if not any(same_port(name, other) for other in self._tasks):
                also = (port.hwid,) if port.vid is not None else ()
                rates = self._settings.rates
                made = self._port(name, rates, also=also, is_named=False)
                self._serve(name, made)

    def _port(
        self,
        name: str,
        rates: tuple[int, ...],
        *,
        also: tuple[str, ...] = (),
        is_named: bool,
    ) -> Port:
        return Port(
            name,
            self._probes,
            self._speaker,
            self._memory,
            rates=rates,
            also=also,
            is_named=is_named,
            has_reset=self._settings.reset,
        )

    def _serve(self, name: str, port: Port) -> None:
        self._ports[name] = port
        self._tasks[name] = self._group.create_task(self._run(name, port))

    async def _run(self, name: str, port: Port) -> None:
        try:
            await port.run()
        finally:
            del self._ports[name], self._tasks[name]
        self._pause(name, port)

    def _pause(self, name: str, port: Port) -> None:
        """After a port that was found was freed."""
        fault = port.fault
        before = self._pauses.pop(name, None)
        if isinstance(fault, PortLost | PortNotFound):
            return  # what comes there next may be another
        now_s = asyncio.get_running_loop().time()
        first_s = REFUSED_S if fault is not None else PAUSE_S
        pause_s = before.next_s if before and not port.had_probe else first_s
        self._pauses[name] = Pause(now_s + pause_s, min(2 * pause_s, PAUSE_MAX_S))
        if fault is not None:
            # Not at the first try: see REFUSED_S.
            if pause_s == 4 * REFUSED_S:
                logger.warning("%s", fault)
        elif before is None and not port.had_probe:
            rates = " or ".join(map(str, self._settings.rates))
            logger.info(
                "%s: no probe is heard at %s baud; the port is left to others and "
                "listened to again, first in %.0f s",
                *(name, rates, pause_s),
            )
