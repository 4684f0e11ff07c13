# SPDX-License-Identifier: MIT
"""Runs imud as on a machine that is not POSIX: python elsewhere.py COMMAND ...

What is not there on Windows is taken away from the modules of imud alone: pyserial and
Python's own continue to use what this machine has.
"""

from __future__ import annotations

import asyncio
import builtins
import os
import selectors
import signal
import stat
import sys
from subprocess import Popen
from typing import Any

MODULES = {"fcntl", "termios", "resource", "pty", "tty", "pwd", "grp", "syslog"}
# Names of os and signal that Windows has not.
MISSING = {
    os: (
        *("fork", "geteuid", "getuid", "statvfs", "fstatvfs", "openpty", "sysconf"),
        *("posix_fadvise", "fdatasync", "killpg", "mkfifo", "nice", "uname"),
    ),
    signal: ("SIGHUP", "SIGKILL", "SIGUSR1", "SIGALRM"),
}


def take_away() -> None:
    real = builtins.__import__

    def importing(name: str, asker: Any = None, *rest: Any, **named: Any) -> Any:
        who = (asker or {}).get("__name__", "")
        if name.partition(".")[0] in MODULES and str(who).startswith("imud"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        found = real(name, asker, *rest, **named)
        if name in ("os", "signal") and str(who).startswith("imud"):
            return poorer(found)
        return found

    builtins.__import__ = importing

    # Python's documentation, "Platform Support" of asyncio's event loops, Windows: this
    # method is not there. Its base class, which raises, takes its place.
    del asyncio.SelectorEventLoop.add_signal_handler
    Popen.__init__ = without_descriptors(Popen.__init__)  # type: ignore[method-assign]
    for kind in (selectors.SelectSelector, selectors.EpollSelector):
        register = kind.register

        def sockets_alone(
            self: Any, fileobj: Any, *rest: Any, register: Any = register
        ) -> Any:
            descriptor = fileobj if isinstance(fileobj, int) else fileobj.fileno()
            if not stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                raise OSError(10038, "not a socket")  # WSAENOTSOCK
            return register(self, fileobj, *rest)

        kind.register = sockets_alone  # type: ignore[method-assign]


def without_descriptors(begin: Any) -> Any:
    """As subprocess has it on Windows, for programs that imud starts itself."""

    def started(self: Any, words: Any, *rest: Any, **named: Any) -> None:
        if named.get("pass_fds"):
            raise ValueError("pass_fds not supported on Windows.")
        begin(self, words, *rest, **named)

    return started


class Poorer:
    """A module without some of its names."""

    def __init__(self, module: Any, missing: tuple[str, ...]) -> None:
        self._module = module
        self._missing = missing

    def __getattr__(self, name: str) -> Any:
        if name in self._missing:
            raise AttributeError(f"module has no attribute {name!r}", name=name)
        return getattr(self._module, name)


def poorer(module: Any) -> Any:
    return Poorer(module, MISSING[module])


if __name__ == "__main__":
    take_away()
    from imud.cli import program

    sys.argv = ["imud", *sys.argv[1:]]
    program()
