# SPDX-License-Identifier: MIT
"""A finder of ports in a loop, and ptys that are plugged in. Unless the settings say
otherwise it tries all of them.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fakes import FakeProbe, Port
from imud.config.settings import Config, PortSettings
from imud.daemon.hub import Hub
from imud.daemon.intake import Intake
from imud.journal.output import Journal
from imud.ports.finder import Finder


@dataclass
class Device:
    """The attributes of a port that pyserial lists."""

    device: str
    hwid: str = "USB VID:PID=1A86:7523 LOCATION=1-1.2"
    vid: int | None = 0x1A86
    pid: int | None = 0x7523
    product: str | None = "USB Serial"
    serial_number: str | None = None
    location: str | None = "1-1.2"


class Desk:
    """A finder in a loop, the ports that are plugged in, what it finds."""

    def __init__(self, directory: Path, **settings: Any) -> None:
        self.directory = directory
        self.devices: list[Device] = []
        self.links: list[Path] = []  # of virtual probes
        kept = {"find": "all", "memory": str(directory / "ports.json")}
        chosen = PortSettings(**(kept | settings))
        self.intake = Intake(Config(ports=chosen), Hub(), Journal())
        self.found: list[str] = []
        self.intake.on_found = self.found.append
        self.finder = Finder(
            *(chosen, self.intake, Journal()),
            listed=lambda: list(self.devices),
            simulated=lambda: list(self.links),
        )

    def plug(self, name: str, baud: int | None = None, **about: Any) -> Port:
        port = Port(self.directory / name, baud)
        self.devices.append(Device(str(port.path), **about))
        return port

    def unplug(self, port: Port) -> None:
        port.vanish()
        self.devices = [d for d in self.devices if d.device != str(port.path)]

    async def until(self, is_so: Callable[[], object]) -> None:
        while not is_so():
            await asyncio.sleep(0.005)

    def port_of(self, probe: FakeProbe) -> str | None:
        entry = self.intake.registry.named(probe.name)
        return entry.port.name if entry and entry.port else None

    async def open_port(self, port: Port) -> None:
        def is_open() -> bool:
            return any(
                p.name == str(port.path) and p.session is not None for p in self.finder
            )

        await self.until(is_open)

    async def say_until_found(
        self, port: Port, probe: FakeProbe, *, every_s: float = 0.1
    ) -> None:
        """Hellos, as on a wire: whatever is heard of them."""
        while self.port_of(probe) != str(port.path):
            port.write(probe.say("hello") + probe.say("status"))
            await asyncio.sleep(every_s)


def at_desk(
    directory: Path, check: Callable[[Desk], Awaitable[None]], **settings: Any
) -> None:
    async def run() -> None:
        desk = Desk(directory, **settings)
        finding = asyncio.create_task(desk.finder.run())
        try:
            checking = asyncio.ensure_future(check(desk))
            done, _ = await asyncio.wait(
                [checking, finding], return_when=asyncio.FIRST_COMPLETED
            )
            for task in done:
                task.result()
            assert checking.done()
        finally:
            finding.cancel()
            await asyncio.gather(finding, return_exceptions=True)
        assert not list(desk.finder)

    asyncio.run(run())
