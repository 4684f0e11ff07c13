# SPDX-License-Identifier: MIT
"""Each command as on a machine without POSIX's modules: it works, or says in one line
why it does not. docs/install.md has the table.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port, free_endpoint
from imud.cli import build_parser
from imud.client import Client
from imud.commands import COMMANDS
from imud.machine import other, posix
from programs import ran
from streaming import until

ELSEWHERE = Path(__file__).with_name("elsewhere.py")

# With a daemon that runs elsewhere, and a probe on its port. {} is a folder; what it
# says is on stdout or, after an error, on stderr.
BESIDE: dict[str, tuple[list[str], str]] = {
    **{
        row.typed: ([], "" if row.by_daemon else f"{row.typed} done")
        for row in COMMANDS.values()
        if row.example
    },
    "list": ([], "00112233445566aa"),
    "monitor": (["--seconds", "0.5"], "00112233445566aa"),
    "listen": (["--seconds", "0.5"], "no pose arrived"),
    "strokes": (["--seconds", "0.5"], "stroke"),
    "record": (["--seconds", "0.5", "--log", "{}/recorded"], "records to"),
    "name": (["00112233445566aa", "00112233445566aa"], "is now called"),
    "mark": (["00112233445566aa", "0.5"], "marked"),
    "magnetometer": (["nosuch", "off"], "no probe nosuch"),
    "params": (["history", "00112233445566aa"], ""),
    "calibrate": (["undo", "nosuch"], "no probe nosuch"),
    "check": (["nosuch"], "no probe nosuch"),
    "flash": (["nosuch"], "no probe nosuch"),
}
ALONE = {
    "config": ([], "[zenoh]"),
    "view": (["--no-open", "--connect", "tcp/127.0.0.1:1"], "no imud at"),
    "keys": (["init", "{}/keys", "--name", "127.0.0.1"], ""),
    "completion": (["bash"], "complete"),
    "ports": ([], ""),
    "info": (["{}/log.mcap"], "pose"),
    "decode": (["{}/log.mcap"], "pose"),
    "export": (["{}/log.mcap", "--out", "{}/tables"], "rows"),
    "recover": (["{}/log.mcap"], ""),
    "refine": (["{}/log.mcap"], "has no raw samples"),
    "audit": (["{}/log.mcap"], "has no raw samples"),
    "import": (["{}/none.csv"], "can't read"),
    "replay": (["{}/log.mcap", "--link", "{}/port"], "no pseudo terminals"),
    "card": (["prepare", "{}/card.img", "--size", "64M"], ""),
    "install-service": (["--print"], "[Service]"),
    "sim": (["nano", "--image", "{}/none"], "does not exist"),
    "demo": (["--help"], "virtual probes"),
    "body": (["{}/none.toml"], "can't read"),
    "bridge": (["all"], "no output is enabled"),
    "run": (["--config", "{}/none.toml"], "can't read"),
}


def said(folder: Path, command: str, words: list[str], *more: str) -> str:
    """A command's output. An internal error of imud fails the test, and so does more
    than one line after an error.
    """
    filled = [word.replace("{}", str(folder)) for word in words]
    done = ran(
        *(sys.executable, "-P", ELSEWHERE, command, *filled, *more),
        cwd=folder,
        timeout=PATIENCE_S,
    )
    assert "internal error" not in done.stderr
    assert "Traceback" not in done.stderr
    if done.returncode != 0:
        assert done.stderr.count("\n") == 1, done.stderr
    return done.stdout + done.stderr


class Desk:
    """A probe, its port, a daemon that runs elsewhere, and a client of it."""

    def __init__(self, folder: Path) -> None:
        self.probe = FakeProbe()
        self.port = Port(folder / "port")
        self.daemon = DaemonProcess(
            self.port.path, directory=folder, program=(str(ELSEWHERE),)
        )
        self.daemon.expect("listens on")
        self.client = Client(self.daemon.endpoint)
        # When it opens its port can't be seen: the hello comes again and again.
        until(self._is_found)

    def _is_found(self) -> bool:
        self.port.write(b"\0" + self.probe.say("hello"))
        return bool(self.client.alive())

    def close(self) -> None:
        self.client.close()
        with self.daemon:
            self.daemon.stop()


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    found = Desk(tmp_path_factory.mktemp("elsewhere"))
    yield found
    found.close()


def has_to_answer(command: str) -> bool:
    """Whether the probe has to answer for this command."""
    return command in COMMANDS and not COMMANDS[command].by_daemon


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", BESIDE)
def test_a_command_beside_a_daemon(command: str, chain: Desk, tmp_path: Path) -> None:
    words, says = BESIDE[command]
    server = threading.Thread(target=chain.port.serve, args=(chain.probe, 1))
    if has_to_answer(command):
        server.start()
    found = said(tmp_path, command, words, "--connect", chain.daemon.endpoint)
    if has_to_answer(command):
        server.join()
    assert says in found


def test_what_a_thread_reads_is_what_was_sent(chain: Desk) -> None:
    heard: queue.Queue[bytes] = queue.Queue()
    chain.client.subscribe("pose", None, lambda _, payload: heard.put(payload))
    chain.client.statuses()  # once it is answered, the daemon knows the subscriber
    for _ in range(200):
        chain.port.write(chain.probe.say("pose"))
    numbers = [json.loads(heard.get())["seq"] for _ in range(200)]
    assert numbers == [*range(numbers[0], numbers[0] + 200)]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log that a daemon elsewhere has written."""
    folder = tmp_path_factory.mktemp("logged")
    found = Desk(folder)
    for _ in range(20):
        found.port.write(found.probe.say("pose"))
    until(lambda: found.client.statuses()[0]["ledger"]["published"].get("pose") == 20)
    found.close()
    (path,) = found.daemon.logs.glob("*.mcap")
    return path


@pytest.mark.sampled(2)
@pytest.mark.parametrize("command", ALONE)
def test_a_command_alone(command: str, log: Path, tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(log.read_bytes())
    words, says = ALONE[command]
    assert says in said(tmp_path, command, words)


def test_every_command_is_tried() -> None:
    assert {*build_parser().commands.choices} == {*BESIDE, *ALONE}


def test_keys_are_refused_where_a_guard_gets_no_sockets(tmp_path: Path) -> None:
    said(tmp_path, "keys", ALONE["keys"][0])
    words = ["--keys", "{}/keys", "--listen", free_endpoint().replace("tcp", "tls")]
    found = said(tmp_path, "run", ["--no-log", "--no-page", *words])
    assert "run imud without keys, or on Linux" in found


def own_names(module: ModuleType) -> set[str]:
    """What a module defines, but for its private names and those of its insides."""
    return {
        name
        for name, value in vars(module).items()
        if not name.startswith("_")
        and not isinstance(value, ModuleType)
        and getattr(value, "__module__", module.__name__) == module.__name__
    }


def test_what_one_kind_of_system_has_the_other_has_too() -> None:
    insides = {"LoopWatch", "ThreadWatch", "READ_S", "WRITE_S"}
    missing = (own_names(posix) ^ own_names(other)) - insides
    # The other clock is a function of Python's own.
    assert missing <= {"TYPE_CHECKING", "msvcrt", "host_clock_ns"}
    assert hasattr(posix, "host_clock_ns")
    assert hasattr(other, "host_clock_ns")
