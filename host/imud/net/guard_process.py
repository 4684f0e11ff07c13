# SPDX-License-Identifier: MIT
"""The process that guards Zenoh's TLS ports: its start, and its reports."""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import subprocess
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence

from imud.endpoint import host_and_port, link_of
from imud.errors import ConfigError, ListenFailed
from imud.machine import system
from imud.net.guard import CAME, REFUSED

TLS = "tls"
BACKLOG = 256
START_S = 10.0
STOP_S = 2.0
AGAIN_S = 1.0  # at least between two starts
HUNG_S = 4.0  # a guard that says nothing for so long is ended: it says BEAT_S

# Connections whose true address is remembered.
KNOWN_MAX = 4096

_LOCAL = re.compile(r"127\.0\.0\.1:\d+")

# Called with a refused address, and the reason.
OnRefused = Callable[[str, str], None]

# Called with the reason for which the guard is started again.
OnRestart = Callable[[str], None]


class GuardProcess:
    """Listens on TLS endpoints in Zenoh's place; close() ends that.

    ListenFailed where an address is taken, ConfigError where it is none.
    """

    def __init__(
        self,
        endpoints: Sequence[str],
        on_refused: OnRefused,
        on_restart: OnRestart = lambda _: None,
    ) -> None:
        if not system.HANDS_ON_SOCKETS:
            raise ListenFailed(
                "TLS ports need a guard process, which this system does not support: "
                "run imud without keys, or on Linux"
            )
        self._on_refused, self._on_restart = on_refused, on_restart
        self._names: OrderedDict[str, str] = OrderedDict()
        self._is_over = threading.Event()
        self._ready = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._sockets: list[socket.socket] = []
        try:
            for endpoint in endpoints:
                self._sockets += _listening(endpoint)
        except BaseException:
            self._close_sockets()
            raise
        self.refused = 0  # connections so far
        self.restarts = 0
        self.port = _free_port()
        self._thread = threading.Thread(
            target=self._run, name="imud-guard", daemon=True
        )
        self._thread.start()

    @property
    def endpoint(self) -> str:
        """Where Zenoh has to listen."""
        return f"{TLS}/127.0.0.1:{self.port}"

    def name_of(self, text: str) -> str:
        """The text with true addresses in the place of the guard's own."""
        return _LOCAL.sub(lambda m: self._names.get(m[0], m[0]), text)

    def opened(self, where: str) -> None:
        """Tells the guard that the client at that own address has a session."""
        own, process = _LOCAL.search(where), self._process
        if own is not None and process is not None and process.stdin is not None:
            with contextlib.suppress(OSError, ValueError):  # it hangs, or has ended
                os.write(process.stdin.fileno(), f"{own[0]}\n".encode())

    def wait_ready(self) -> None:
        """Until who connects is let in."""
        if not self._ready.wait(START_S):
            raise ListenFailed("the guard process of the TLS port does not start")

    def close(self) -> None:
        self._is_over.set()
        process = self._process
        if process is not None and process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()
        self._thread.join(STOP_S)
        self._close_sockets()

    def _close_sockets(self) -> None:
        for each in self._sockets:
            each.close()

    def _run(self) -> None:
        """A guard that ends, for whatever reason, is started again."""
        while not self._is_over.is_set():
            begin_s = time.monotonic()
            try:
                why = self._serve()
            except OSError as error:
                why = f"can't be started: {error.strerror}"
            if not self._is_over.is_set():
                self.restarts += 1
                self._on_restart(why)
            self._is_over.wait(begin_s + AGAIN_S - time.monotonic())

    def _serve(self) -> str:
        """Runs a guard until it ends or hangs, and returns which."""
        descriptors = [each.fileno() for each in self._sockets]
        words = [str(self.port), *map(str, descriptors)]
        with subprocess.Popen(
            [sys.executable, "-P", "-m", "imud.net.guard", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            pass_fds=descriptors,
            start_new_session=True,
        ) as process:
            self._process = process
            if process.stdin is not None:
                os.set_blocking(process.stdin.fileno(), False)
            if self._is_over.is_set() and process.stdin is not None:
                process.stdin.close()
            if self._listen(process):
                return f"ended with code {process.wait()}"
            process.kill()
            return f"did nothing for {HUNG_S:g} s"

    def _listen(self, process: subprocess.Popen[bytes]) -> bool:
        """Until the guard ends; False: it hangs."""
        pipe, rest = process.stdout, b""
        if pipe is None:
            return True
        ready = select.poll()  # select() takes no descriptor above 1023
        ready.register(pipe, select.POLLIN)
        wait_s = START_S
        while ready.poll(1000 * wait_s):
            data = os.read(pipe.fileno(), 65536)
            if not data:
                return True
            wait_s = HUNG_S
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._hear(line.decode("ascii", "replace").split(maxsplit=2))
        return False

    def _hear(self, words: list[str]) -> None:
        match words:
            case ["ready"]:
                self._ready.set()
            case [what, own, name] if what == CAME:
                while len(self._names) >= KNOWN_MAX:
                    self._names.popitem(last=False)
                self._names[own] = name.strip()
            case [what, count, rest] if what == REFUSED:
                name, _, why = rest.partition(" ")
                self.refused += int(count)
                self._on_refused(name, why.strip())


def guarded(endpoints: Sequence[str]) -> list[str]:
    """The endpoints that need a guard."""
    return [each for each in endpoints if link_of(each) == TLS]


def _listening(endpoint: str) -> list[socket.socket]:
    address = host_and_port(endpoint.partition("/")[2].partition("#")[0])
    if address is None:
        raise ConfigError(f"zenoh.listen: {endpoint} is not {TLS}/HOST:PORT")
    host, port = address
    made: list[socket.socket] = []
    try:
        for family, kind, _, _, place in socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        ):
            each = socket.socket(family, kind)
            made.append(each)
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                each.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, host != "::")
            each.bind(place)
            each.listen(BACKLOG)
    except OSError as error:
        for each in made:
            each.close()
        raise ListenFailed(
            f"can't listen on {endpoint}: it is taken or not an address of this "
            "machine; stop the other imud run, or choose another with --listen"
        ) from error
    return made


def _free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])
