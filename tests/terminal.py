# SPDX-License-Identifier: MIT
"""A terminal that a test reads and types on."""

from __future__ import annotations

import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from fcntl import ioctl

from fakes import PATIENCE_S


class Terminal:
    """A terminal of 80x24 with a command of imud in it."""

    def __init__(self, *words: str) -> None:
        self._master, slave = pty.openpty()
        self.resize(80, 24)
        self._before = termios.tcgetattr(slave)
        self._slave = slave
        self.text = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "imud", *words],
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env=os.environ | {"TERM": "xterm-256color"},
        )

    def resize(self, columns: int, rows: int) -> None:
        ioctl(self._master, termios.TIOCSWINSZ, struct.pack("4H", rows, columns, 0, 0))

    def press(self, keys: bytes) -> None:
        os.write(self._master, keys)

    def until(self, is_so: Callable[[str], bool]) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not is_so(self.text):
            assert time.monotonic() < end_s, self.text[-2000:]
            if select.select([self._master], [], [], 0.1)[0]:
                self.text += os.read(self._master, 65536).decode(errors="replace")

    def end(self) -> int:
        """Its exit code; what it still draws is read meanwhile."""
        self.until(lambda _: self.process.poll() is not None)
        while select.select([self._master], [], [], 0)[0]:
            self.text += os.read(self._master, 65536).decode(errors="replace")
        assert termios.tcgetattr(self._slave) == self._before
        return self.process.returncode

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._master)
        os.close(self._slave)
