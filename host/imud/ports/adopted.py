# SPDX-License-Identifier: MIT
"""The ports that are ours: a probe was heard there once, or a person has said so.

They are kept in a file, by what is plugged in and where. A chip without a serial number
of its own is known again only in the same socket.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import msgspec

from imud import json_file
from imud.errors import FileError
from imud.machine import system
from imud.ports.adapters import Listed, kind_of

# A service's own folder, and that of a person who runs the daemon.
SERVICE_FOLDER = Path("/var/lib/imud")
FILE = "ports.json"

# In a path of /sys: the controller, and the socket with the interface.
_PLACE = re.compile(r"/([^/]+)/usb\d+/(?:.*/)?\d+-([\d.]+:\d+\.\d+)(?:/|$)")


class AdoptedPort(msgspec.Struct, frozen=True):
    """`adapter`: vendor, product and serial number; `place`: the socket."""

    adapter: str
    place: str
    kind: str  # in words
    since: str  # date
    by: str  # "probe", and its id; or "person"


class _Memory(msgspec.Struct):
    ports: list[AdoptedPort]


def file_of(named: str = "") -> Path:
    """Where the daemon that runs so remembers: `named` is the setting."""
    if named:
        return Path(named)
    if folder := os.environ.get("STATE_DIRECTORY"):
        return Path(folder.split(":")[0]) / FILE
    if system.is_administrator() and SERVICE_FOLDER.is_dir():
        return SERVICE_FOLDER / FILE
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "imud" / FILE


def adapter_id(port: Listed) -> str:
    if port.vid is None or port.pid is None:
        return _bluetooth_address(port.device) or port.device
    return f"{port.vid:04x}:{port.pid:04x}:{port.serial_number or ''}"


def place_of(port: Listed) -> str:
    """The controller and the socket, as udev's ID_PATH has them; with the interface of
    a chip with several ports. Empty for Bluetooth.
    """
    if port.vid is None:
        return ""
    path = os.path.realpath(f"/sys/class/tty/{Path(port.device).name}/device")
    if (found := _PLACE.search(path)) is not None:
        return f"{found[1]}-usb-0:{found[2]}"
    return port.location or ""


def is_unique(serial: str | None) -> bool:
    """Whether a serial number tells one device from another: makers that have none
    write 0001, 123456 or zeros into all.
    """
    text = serial or ""
    digits = "0123456789ABCDEF" * 2
    return len(text) >= 6 and len(set(text)) > 2 and text.upper() not in digits


class AdoptedPorts:
    """Reads the file again whenever it has changed, and writes it at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: list[AdoptedPort] = []
        self._state: tuple[int, int] | None = None  # of the file that was read

    @property
    def known(self) -> tuple[AdoptedPort, ...]:
        """As last read."""
        return tuple(self._known)

    def find(self, port: Listed) -> AdoptedPort | None:
        """Its entry; None: it is not ours."""
        adapter, place = adapter_id(port), place_of(port)
        is_anywhere = port.vid is None or is_unique(port.serial_number)
        for each in self._known:
            if each.adapter != adapter:
                continue
            # A chip with several ports has one serial number for all.
            is_same = _interface(each.place) == _interface(place)
            if each.place == place or (is_anywhere and is_same):
                return each
        return None

    def refresh(self) -> bool:
        """Reads the file if it has changed, and says whether it has. FileError: it is
        none of ours.
        """
        try:
            at = self.path.stat()
        except FileNotFoundError:
            has_changed, self._known, self._state = self._state is not None, [], None
            return has_changed
        except OSError as error:
            raise FileError(f"can't read {self.path}: {error.strerror}") from error
        state = (at.st_mtime_ns, at.st_ino)
        if state == self._state:
            return False
        cure = "remove it, and adopt the ports again"
        self._known = json_file.read(self.path, _Memory, cure).ports
        self._state = state
        return True

    def adopt(self, port: Listed, by: str) -> bool:
        """Whether it was not ours before. FileError if that can't be kept."""
        self.refresh()
        if self.find(port) is not None:
            return False
        new = AdoptedPort(
            adapter_id(port),
            place_of(port),
            kind_of(port),
            time.strftime("%Y-%m-%d"),
            by,
        )
        self._write([*self._known, new])
        return True

    def release(self, port: Listed) -> bool:
        """Whether it was ours. FileError if that can't be kept."""
        self.refresh()
        is_known = False
        while (known := self.find(port)) is not None:
            is_known = True
            self._known.remove(known)
        if is_known:
            self._write(self._known)
        return is_known

    def _write(self, ports: list[AdoptedPort]) -> None:
        """They are ours for as long as this runs, even if they can't be written."""
        self._known = ports
        at = json_file.write(self.path, _Memory(ports))
        self._state = (at.st_mtime_ns, at.st_ino)


def _interface(place: str) -> str:
    return place.rpartition(":")[2] if ":" in place else ""


def _bluetooth_address(device: str) -> str:
    """Address of the other end of an rfcomm port (net/bluetooth/rfcomm/tty.c:
    `address`)."""
    try:
        path = Path("/sys/class/tty") / Path(device).name / "address"
        return path.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
