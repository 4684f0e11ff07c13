# SPDX-License-Identifier: MIT
"""Python programs as processes that need not import what they use: a process that has
imported it forks for each, which takes half a second less than a start of Python.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import select
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

STARTER = Path(__file__).with_name("starter.py")


@functools.cache
def _starter() -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """This process's starter, which ends with it, and the connection to it."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its:
        command: list[str] = [sys.executable, "-P", str(STARTER), str(its.fileno())]
        return ours, subprocess.Popen(command, pass_fds=[its.fileno()])


class Forked(subprocess.Popen[str]):
    """A Popen, as text, of `python -P` with these arguments: `-m MODULE ...` or
    `-c CODE ...`. Of Popen's options it takes the streams, `cwd` and `env`.

    What it overrides of Popen is the same in CPython 3.11 to 3.13.
    """

    def __init__(self, *arguments: object, **options: Any) -> None:
        super().__init__([str(each) for each in arguments], text=True, **options)

    def _execute_child(self, args: list[str], *rest: Any) -> None:
        cwd, env = rest[4:6]
        pipes = rest[9:15]  # both ends of standard input's, output's and error's
        streams = [
            number if end == -1 else end
            for number, end in enumerate((pipes[0], pipes[3], pipes[5]))
        ]
        wanted = {
            "arguments": args,
            "cwd": str(cwd or Path.cwd()),
            "env": dict(os.environ if env is None else env),
        }
        ours, its = os.pipe()
        connection, _ = _starter()
        socket.send_fds(connection, [json.dumps(wanted).encode()], [*streams, its])
        os.close(its)
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]
        self._end = os.fdopen(ours, "rb", buffering=0)
        self.pid = int(self._end.readline())
        self._child_created = True

    def _try_wait(self, wait_flags: int) -> tuple[int, int]:
        """As os.waitpid()."""
        if wait_flags and not select.select([self._end], [], [], 0)[0]:
            return 0, 0
        with self._end:
            return self.pid, int(self._end.read())

    def _internal_poll(self, _deadstate: object = None) -> int | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0)
        return self.returncode
