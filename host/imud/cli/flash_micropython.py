# SPDX-License-Identifier: MIT
"""`imud flash --board micropython` and `--wifi`: from a board at MicroPython's prompt
to a probe that has greeted, over USB or over the air.
"""

from __future__ import annotations

import argparse
import contextlib
import getpass
import json
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from imud.cli import check_ports, flash_client, flash_run, reached
from imud.cli.flash_run import say
from imud.client import Client
from imud.config import reader
from imud.config.settings import PortSettings, state_home
from imud.endpoint import host_and_port
from imud.errors import ConfigError, DaemonNotFound, FlashError
from imud.flash import micropython, serial_port, wifi
from imud.flash.micropython import Board, Prompt
from imud.net import probe_keys
from imud.wire.schema import FINGERPRINT

COMMAND = flash_run.COMMAND
EVERYWHERE, UDP_PORT = "0.0.0.0", 8736  # noqa: S104 - where probes are, once asked
HELLO_S = 30.0  # a board that starts and joins
TICK_S = 0.2


def run(args: argparse.Namespace) -> int:
    """Writes one board; returns the exit code."""
    with contextlib.ExitStack() as stack:
        air = _daemon_for_air(args, stack) if args.wifi and not args.dry_run else None
        with (
            _borrowed(args) as port,
            serial_port.opened(port, micropython.BAUD) as wire,
        ):
            prompt = Prompt(wire)
            if args.forget_wifi:
                return _forget(prompt, port, args.dry_run)
            board = prompt.board(needs_wifi=bool(args.wifi))
            if _copied(args, prompt, port, board) is None:
                return 0
            probe = "" if air is None else air.join(prompt)
            prompt.restart()
        if air is not None:
            return air.await_hello(probe)
        found = reached.probe(args, port, COMMAND, stack)
        say(f"{found.status['probe']} runs {found.status['hello']['firmware']}")
    return 0


def _copied(
    args: argparse.Namespace, prompt: Prompt, port: str, board: Board
) -> int | None:
    """How many files were copied; None: none was to be."""
    say(f"{port}: {board.name}, {board.arch}")
    files = micropython.files_for(board, f"{FINGERPRINT:08x}")
    if not args.force and _is_own(prompt, port, board.main):
        del files[micropython.MAIN]
        say("its main.py, which starts a probe, stays; --force replaces it")
    if args.dry_run:
        say(f"{len(files)} files: {', '.join(files)}; nothing was written")
        return None
    bar = flash_client.bar_for(None)
    try:
        count = prompt.put(files, lambda done, of: bar.update(done / of))
    finally:
        bar.end()
    say(f"{count} of {len(files)} files copied and read back; the others were there")
    return count


def _is_own(prompt: Prompt, port: str, ours: str) -> bool:
    """Whether its main.py is a person's own for a probe; FlashError if it is for
    something else.
    """
    text = prompt.value(
        f"try:print(repr(open({micropython.MAIN!r}).read(4000)))\n"
        "except OSError:print(repr(''))",
        str,
    )
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    if "from probe" not in text and any(map(str.strip, lines)):
        raise FlashError(
            f"the board on {port} has a main.py that is not a probe's; save it, and "
            "replace it with --force"
        )
    return "from probe" in text and text != ours


@contextlib.contextmanager
def _borrowed(args: argparse.Namespace) -> Iterator[str]:
    """The board's port, which a daemon has closed meanwhile if it had it."""
    try:
        client = Client(args.connect, args.prefix, args.keys)
    except DaemonNotFound:
        yield args.port or check_ports.only_port(COMMAND)
        return
    with client:
        for status in client.statuses():
            names = (status["probe"], status["probe_id"])
            if args.port in names or reached.is_on(status, str(args.port)):
                with flash_run.lent(client, str(status["probe"])) as port:
                    yield port
                    return
    yield args.port or check_ports.only_port(COMMAND)


def _forget(prompt: Prompt, port: str, is_dry: bool) -> int:
    if is_dry:
        say(f"{port}: {wifi.CONFIG} and {wifi.KEY} would be deleted; nothing was")
        return 0
    for name in (wifi.CONFIG, wifi.KEY):
        prompt.remove(name)
        prompt.remove(name + micropython.PART)  # of a copy that was cut off
    prompt.restart()
    say(
        f"{port}: network, password and key are deleted; delete the daemon's key, too: "
        "DIR/probes/ID.key of its udp_keys"
    )
    return 0


class Air:
    """The daemon that the board is to greet."""

    def __init__(
        self,
        args: argparse.Namespace,
        client: Client,
        ports: PortSettings,
        check: Callable[[], None],
    ) -> None:
        self._name: str = args.wifi
        self._file: Path = args.config
        try:
            self._password = getpass.getpass(f"password of {args.wifi}: ")
        except EOFError as error:
            raise FlashError("no password; the board was not changed") from error
        self._client = client
        self._check = check
        self._keys = Path(ports.udp_keys)
        address = host_and_port(ports.udp)
        self._port = UDP_PORT if address is None else address[1]
        self._before: dict[str, int] = {}

    def join(self, prompt: Prompt) -> str:
        """The board's id, once it is in the network and was answered."""
        probe = wifi.probe_id(prompt)
        key = self._keys / probe_keys.PROBES / f"{probe}.key"
        if not key.exists():
            probe_keys.make(self._keys, probe)
        board = wifi.join(prompt, self._name, self._password)
        say(f"in {self._name} as {board.ip}")
        host = wifi.host_towards(board.ip)
        prompt.put({wifi.KEY: key.read_bytes()}, _quiet)
        self._check()  # that the port is open
        wifi.greet(prompt, board, host, self._port)
        told = wifi.settings(self._name, self._password, host, self._port)
        prompt.put({wifi.CONFIG: told}, _quiet)
        say(
            f"{wifi.CONFIG} and {wifi.KEY} are on the board: who has it can read the "
            f"password; {COMMAND} --forget-wifi deletes both"
        )
        statuses = self._client.statuses()
        self._before = {each["probe_id"]: _sessions(each) for each in statuses}
        return probe

    def await_hello(self, probe: str) -> int:
        until_s = time.monotonic() + HELLO_S
        while time.monotonic() < until_s:
            for status in self._client.statuses():
                is_it = status["probe_id"] == probe
                if is_it and _sessions(status) > self._before.get(probe, 0):
                    say(f"{probe} greets over the air, on {status['port']}")
                    say(f"unplug it; it is a probe of: imud run --config {self._file}")
                    return 0
            time.sleep(TICK_S)
        raise FlashError(
            f"{probe} was answered, but sent no hello in {HELLO_S:g} s; plug it in "
            "again, and check with imud list"
        )


def _sessions(status: dict[str, Any]) -> int:
    """Signed sessions that it has begun."""
    return int(status.get("link", {}).get("datagrams", {}).get("sessions", 0))


def _quiet(_done: int, _of: int) -> None:
    """A few bytes need no bar."""


def _daemon_for_air(args: argparse.Namespace, stack: contextlib.ExitStack) -> Air:
    """The daemon that runs, or one for as long as this command, with its port open."""
    file: Path = args.config
    ports = reader.load(file).ports if file.exists() else PortSettings()
    if is_new := not ports.udp:
        say(
            f"probes on Wi-Fi send to UDP port {UDP_PORT} of this machine, which "
            "accepts what one of its probes has signed (docs/micropython.md)"
        )
        if not args.yes and not _agrees(f"open it, in {file}?"):
            raise FlashError("not opened, and nothing was written; --yes opens it")
        keys = Path(state_home()).expanduser() / "imud" / "keys"
        (keys / probe_keys.PROBES).mkdir(0o700, parents=True, exist_ok=True)
        open_udp(file, keys)
        ports = reader.load(file).ports
    try:
        client = Client(args.connect, args.prefix, args.keys)
    except DaemonNotFound:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        own = folder / "imud.toml"
        own.write_text(f"[ports]\nfind = false\n{_lines(ports.udp, ports.udp_keys)}")
        daemon = stack.enter_context(check_ports.OwnDaemon("", config=own))
        return Air(args, stack.enter_context(daemon.client()), ports, daemon.check)
    stack.enter_context(client)
    if is_new:
        raise FlashError(
            f"{file} opens the port; restart imud run with --config {file}, and run "
            "this again"
        )
    return Air(args, client, ports, lambda: None)


def _agrees(question: str) -> bool:
    if not sys.stdin.isatty():
        return False
    with contextlib.suppress(EOFError):
        return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")
    return False


def _lines(udp: str, keys: str) -> str:
    return f"udp = {json.dumps(udp)}\nudp_keys = {json.dumps(keys)}\n"


def open_udp(file: Path, keys: Path) -> None:
    """Adds the port and the folder of its keys to a daemon's file. ConfigError with the
    lines if that can't be done.
    """
    lines = _lines(f"{EVERYWHERE}:{UDP_PORT}", str(keys))
    real = file.resolve()  # of a link
    part = real.with_name(f"{real.name}.part")
    try:
        text = file.read_text("utf-8") if file.exists() else ""
        if file.exists():
            shutil.copy(real, part)  # its permissions
        text = re.sub(r'(?m)^udp(_keys)?\s*=\s*""\s*(#.*)?\n', "", text)
        head = re.search(r"(?m)^\[ports\][^\n]*\n", text)
        at = len(text) if head is None else head.end()
        title = "" if head is not None else "\n[ports]\n" if text else "[ports]\n"
        part.write_text(text[:at] + title + lines + text[at:], "utf-8")
        reader.load(part)
        part.replace(real)
    except (OSError, ConfigError) as error:
        hint = lines.strip().replace("\n", ", ")
        raise ConfigError(f"can't open it in {file}: add to [ports]: {hint}") from error
    finally:
        part.unlink(missing_ok=True)
