# SPDX-License-Identifier: MIT
"""Serves the ports that are named and those of datagrams, and finds other ports with a
probe on them.

Opening a port resets many boards and takes bytes from other programs: of the ports that
nobody named, it opens those that are ours, and all only if the settings say so. One
without a probe is closed at once, and tried again after pauses that grow.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from serial.tools import list_ports

from imud.config.settings import PortSettings, port_and_baud
from imud.errors import FileError, PortLost, PortNotFound
from imud.journal.output import Journal
from imud.ports.adapters import Listed, kind_of
from imud.ports.adopted import AdoptedPorts, file_of
from imud.ports.baud import Memory
from imud.ports.holders import holders_of
from imud.ports.port import Port
from imud.ports.receiver import EventReceiver
from imud.ports.standing import (
    OPENED,
    Standing,
    is_candidate,
    is_ignored,
    same_port,
    standing_of,
)
from imud.ports.udp import UdpPorts

# The ports are listed this often, which takes 0.9 ms, and whenever /dev changes.
LIST_S = 1.0
LOOK_S = 0.1
DEVICES = Path("/dev")

# Until a port without a probe is tried again; doubled each time.
PAUSE_S = 5.0
PAUSE_MAX_S = 300.0

# A port that has just appeared can't be opened until udev has set its permissions.
REFUSED_S = 0.2

logger = logging.getLogger("imud")


@dataclass(slots=True)
class Pause:
    """When a port that exists is tried again."""

    until_s: float
    next_s: float


class Finder:
    """Runs a Port for each port that is named or may have a probe, and UdpPorts."""

    def __init__(
        self,
        settings: PortSettings,
        probes: EventReceiver,
        journal: Journal,
        *,
        listed: Callable[[], Iterable[Listed]] = list_ports.comports,
        simulated: Callable[[], Iterable[Path]] = tuple,
    ) -> None:
        """`simulated`: the ports of virtual probes that run."""
        self._settings = settings
        self._probes = probes
        self._journal = journal
        self._listed = listed
        self._simulated = simulated
        # For what may wait: a slow driver's answer, a disk, a look-up of a name.
        self._waiter = ThreadPoolExecutor(1, "imud-finder")
        self._memory = Memory()
        self._udp = UdpPorts(probes, journal)
        self._ports: dict[str, Port] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._pauses: dict[str, Pause] = {}
        self._told: set[str] = set()  # ports of which was told why they stay closed
        self._adopted = AdoptedPorts(file_of(settings.memory))
        self._heard: dict[str, str] = {}  # ports to be adopted, and whose hello it was
        self._lent: dict[str, float] = {}  # ports, and the loop's time of their return
        self._changed = asyncio.Event()
        self._dev_ns = 0

    def __iter__(self) -> Iterator[Port]:
        return iter(list(self._ports.values()))

    def configure(self, settings: PortSettings) -> None:
        """Applies new settings. Ports that are no longer named are closed."""
        if settings.memory != self._settings.memory:
            self._adopted = AdoptedPorts(file_of(settings.memory))
        self._settings = settings
        self._changed.set()

    async def lend(self, name: str, seconds: float) -> None:
        """Closes a port for another program, before it returns; after that time, or
        with 0 seconds, it is opened again.
        """
        self._lent[name] = asyncio.get_running_loop().time() + seconds
        serving = self._tasks.get(name)
        if seconds > 0 and serving is not None:
            serving.cancel()
            await asyncio.wait([serving])
            logger.info("%s: lent for %.0f s", name, seconds)
        self._pauses.pop(name, None)
        self._changed.set()

    def _is_lent(self, name: str) -> bool:
        now_s = asyncio.get_running_loop().time()
        self._lent = {
            port: end_s for port, end_s in self._lent.items() if end_s > now_s
        }
        return any(same_port(name, port) for port in self._lent)

    def check(self, t_ns: int) -> None:
        """Called once a second with the host's time."""
        for port in self:
            port.check(t_ns)
        self._udp.check(t_ns)

    async def run(self) -> None:
        """Runs until it is cancelled."""
        self._loop = asyncio.get_running_loop()
        try:
            async with asyncio.TaskGroup() as self._group:
                while True:
                    self._serve_named()
                    await self._udp.serve(self._settings, self._waiter)
                    if self._settings.find or self._heard:
                        await self._serve_found()
                    await self._wait()
        except ExceptionGroup as faults:
            raise faults.exceptions[0] from None
        finally:
            self._udp.close()
            self._waiter.shutdown(wait=False)

    async def _wait(self) -> None:
        """Waits for the next listing, a change in /dev or new settings."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + LIST_S
        while (left_s := until_s - loop.time()) > 0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), min(LOOK_S, left_s))
            if self._changed.is_set() or self._is_dev_changed():
                break
        self._changed.clear()

    def _is_dev_changed(self) -> bool:
        """Whether a port came or went, by the time of the folder; takes 2 us."""
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
            if name not in self._tasks and not self._is_lent(name):
                rates = (baud,) if baud else settings.rates
                self._serve(name, self._port(name, rates, is_named=True))

    async def _serve_found(self) -> None:
        in_thread = partial(asyncio.get_running_loop().run_in_executor, self._waiter)
        listed = await in_thread(lambda: list(self._listed()))
        await in_thread(self._adopt_heard, listed)
        if not self._settings.find:
            return
        found = {p.device: p for p in listed if is_candidate(p, self._settings.ignore)}
        links = await in_thread(lambda: list(map(str, self._simulated())))
        for name in self._pauses.keys() - found.keys() - set(links):
            del self._pauses[name]  # unplugged: the next device there may be another
        self._told &= found.keys()
        if await in_thread(self._read_adopted):
            self._close_released(found)
        for name, port in found.items():
            if not self._is_due(name):
                continue
            if not self._may_open(port) or await self._is_held(name):
                continue
            self._told.discard(name)
            also = (port.hwid,) if port.vid is not None else ()
            rates = self._settings.rates
            self._serve(name, self._port(name, rates, also=also, is_named=False))
        for name in links:
            if self._is_due(name) and not is_ignored(name, "", self._settings.ignore):
                rates = self._settings.rates
                self._serve(name, self._port(name, rates, is_named=False))

    def _is_due(self, name: str) -> bool:
        """Whether a port is neither open nor lent, nor to be tried later."""
        pause = self._pauses.get(name)
        if pause is not None and asyncio.get_running_loop().time() < pause.until_s:
            return False
        return not self._is_lent(name) and not any(
            same_port(name, other) for other in self._tasks
        )

    def _may_open(self, port: Listed) -> bool:
        """Whether a port may be opened. Told once, if a person may change that."""
        standing = standing_of(port, self._settings, self._adopted)
        if standing is Standing.UNKNOWN and port.device not in self._told:
            self._told.add(port.device)
            logger.info(
                "%s: %s, which may belong to another program: not opened; if a probe "
                "is on it: imud ports adopt %s",
                *(port.device, kind_of(port), port.device),
            )
        return standing in OPENED

    def _read_adopted(self) -> bool:
        """Whether the ports that are ours have changed."""
        try:
            return self._adopted.refresh()
        except FileError as error:
            self._warn(str(error))
            return False

    def _warn(self, text: str) -> None:
        """Called in another thread."""
        write = partial(self._journal.write, "adopted", text, is_warning=True)
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(write)

    def _close_released(self, found: Mapping[str, Listed]) -> None:
        for name, port in self._ports.items():
            if not port.is_named and name in found and not self._may_open(found[name]):
                self._tasks[name].cancel()

    def _hear(self, name: str, probe_id: str) -> None:
        """A probe is on that port, so that it is ours from now on."""
        self._heard[name] = probe_id
        self._changed.set()

    def _adopt_heard(self, listed: Iterable[Listed]) -> None:
        """Remembers the ports on which a probe was heard; in another thread."""
        heard, self._heard = self._heard, {}
        for name, probe_id in heard.items():
            port = next((p for p in listed if same_port(p.device, name)), None)
            if port is None or not is_candidate(port, ()):
                continue  # a pty, or a port of the machine, which is opened if named
            try:
                self._adopted.adopt(port, f"probe {probe_id}")
            except FileError as error:
                self._warn(f"{name} is adopted only until imud exits: {error}")

    async def _is_held(self, name: str) -> bool:
        """Whether another program has that port open: then it is left alone, and tried
        again after a while. Told once.
        """
        holders = await asyncio.get_running_loop().run_in_executor(
            self._waiter, holders_of, name
        )
        if not holders:
            return False
        now_s = asyncio.get_running_loop().time()
        self._pauses[name] = Pause(now_s + PAUSE_S, PAUSE_S)
        if name not in self._told:
            self._told.add(name)
            logger.info(
                "%s: in use by %s; imud waits until it is closed",
                *(name, ", ".join(map(str, holders))),
            )
        return True

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
            self._journal,
            self._memory,
            rates=rates,
            also=also,
            is_named=is_named,
            has_reset=self._settings.reset,
            on_known=partial(self._hear, name),
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
        """Says when a port that was found and closed is tried again."""
        fault = port.fault
        before = self._pauses.pop(name, None)
        if isinstance(fault, PortLost | PortNotFound):
            return  # the next device there may be another
        now_s = asyncio.get_running_loop().time()
        first_s = REFUSED_S if fault is not None else PAUSE_S
        pause_s = before.next_s if before and not port.had_probe else first_s
        self._pauses[name] = Pause(now_s + pause_s, min(2 * pause_s, PAUSE_MAX_S))
        if fault is not None:
            # Not told at the first tries: see REFUSED_S.
            if pause_s == 4 * REFUSED_S:
                logger.warning("%s", fault)
        elif before is None and not port.had_probe:
            rates = " or ".join(map(str, self._settings.rates))
            logger.info(
                "%s: no probe detected at %s baud; the port is closed for other "
                "programs and retried, first in %.0f s",
                *(name, rates, pause_s),
            )
