# SPDX-License-Identifier: MIT
"""Tells systemd the state of the daemon: sd_notify(3), a datagram on a socket."""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Mapping


class Notifier:
    """Sends nothing without $NOTIFY_SOCKET."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        # An @ stands for the zero with which an abstract address begins.
        self._address = "\0" + address[1:] if address.startswith("@") else address

    def ready(self) -> None:
        self._send("READY=1")

    def status(self, text: str) -> None:
        """A line for `systemctl status`."""
        self._send(f"STATUS={text}")

    def alive(self) -> None:
        """Due within WatchdogSec; a loop that hangs doesn't send it."""
        self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """A reload lasts until the next ready()."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
        # A manager that can't be reached is no reason to stop.
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, kind) as end:
            end.sendto(text.encode(), self._address)
