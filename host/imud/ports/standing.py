# SPDX-License-Identifier: MIT
"""Whether the daemon may open a port, and why; also for `imud ports` and the page."""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Iterable, Iterator
from enum import Enum
from pathlib import Path

import msgspec

from imud.config.settings import PortSettings, port_and_baud
from imud.ports.adapters import Listed, is_ours_alone, kind_of
from imud.ports.adopted import AdoptedPorts
from imud.ports.holders import holders_of


class Standing(Enum):
    """Whether a port is opened, and why; checked in this order."""

    NAMED = "named"
    IGNORED = "ignored"
    BUILT_IN = "built in"
    OURS = "ours alone"
    ADOPTED = "adopted"
    OFF = "off"
    ANY = "any"
    UNKNOWN = "unknown"


OPENED = (Standing.NAMED, Standing.OURS, Standing.ADOPTED, Standing.ANY)


class PortRow(msgspec.Struct, frozen=True):
    """A port of this machine, as `imud ports --json` has it."""

    port: str
    kind: str
    standing: str
    is_opened: bool  # by a daemon with these settings
    why: str
    held_by: list[str]  # programs, as far as this user may see them


def same_port(a: str, b: str) -> bool:
    """Whether two paths are the same port; /dev/serial/by-id/... has links."""
    return os.path.realpath(a) == os.path.realpath(b)


def is_candidate(port: Listed, ignore: Iterable[str]) -> bool:
    """Whether a port may have a probe: USB and Bluetooth, unless a pattern of `ignore`
    has it. A built-in port may control other equipment.
    """
    return _can_be_found(port) and not is_ignored(port.device, port.hwid, ignore)


def standing_of(
    port: Listed, settings: PortSettings, adopted: AdoptedPorts
) -> Standing:
    """Takes up to a millisecond; reads no file."""
    if any(same_port(port_and_baud(n)[0], port.device) for n in settings.named):
        return Standing.NAMED
    if is_ignored(port.device, port.hwid, settings.ignore):
        return Standing.IGNORED
    if not _can_be_found(port):
        return Standing.BUILT_IN
    if settings.find is False:
        return Standing.OFF
    if is_ours_alone(port):
        return Standing.OURS
    if adopted.find(port) is not None:
        return Standing.ADOPTED
    return Standing.ANY if settings.find == "all" else Standing.UNKNOWN


def rows(
    listed: Iterable[Listed], settings: PortSettings, adopted: AdoptedPorts
) -> Iterator[PortRow]:
    """The row of each port, sorted."""
    for port in sorted(listed, key=lambda each: each.device):
        standing = standing_of(port, settings, adopted)
        yield PortRow(
            port=port.device,
            kind=kind_of(port),
            standing=standing.value,
            is_opened=standing in OPENED,
            why=_why(port, standing, adopted),
            held_by=[str(each) for each in holders_of(port.device)],
        )


def _why(port: Listed, standing: Standing, adopted: AdoptedPorts) -> str:
    name = port.device
    known = adopted.find(port)
    since = f"{known.by}, {known.since}" if known is not None else ""
    return {
        Standing.NAMED: "named: opened",
        Standing.IGNORED: "in [ports] ignore: never opened",
        Standing.BUILT_IN: f"opened only if given: imud run {name}",
        Standing.OURS: "a probe according to its USB name: opened",
        Standing.ADOPTED: f"ours ({since}): opened; to stop that: imud ports release "
        f"{name}",
        Standing.OFF: "not opened: [ports] find is off",
        Standing.ANY: 'opened, like all ports: [ports] find is "all"',
        Standing.UNKNOWN: "not opened: may belong to another program; if a probe is "
        f"on it: imud ports adopt {name}",
    }[standing]


def _can_be_found(port: Listed) -> bool:
    return port.vid is not None or Path(port.device).name.startswith("rfcomm")


def is_ignored(device: str, hwid: str, ignore: Iterable[str]) -> bool:
    """Whether a pattern of `ignore` has that path, its device or the hardware's id."""
    return any(
        fnmatch.fnmatchcase(name, pattern) or same_port(device, pattern)
        for pattern in ignore
        for name in (device, hwid)
    )
