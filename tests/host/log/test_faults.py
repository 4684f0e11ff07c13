# SPDX-License-Identifier: MIT
"""`imud run` on a disk that fills up: a real one, of memory, in a mount namespace of
the daemon's own. What is not logged is counted and told.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import queue
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fakes import DaemonProcess, FakeProbe, Port, Stopwatch
from imud.client import Client
from log_files import frames
from streaming import Streaming

# A plain user becomes root of a namespace of users, which a chroot forbids to root.
IS_ROOT = os.geteuid() == 0
UNSHARE = ("unshare", "-m" if IS_ROOT else "-rm")

# Its folder of logs is a file system of 2 MB that nobody else sees.
IN_A_NAMESPACE = """
import os, sys
mount = 'mount -t tmpfs -o size=2m none "$0" && exec "$@"'
own = [sys.executable, "-m", "imud", *sys.argv[1:]]
os.execvp("unshare", [*{unshare!r}, "sh", "-c", mount, {logs!r}, *own])
"""

Record = Callable[[str, object], None]

# What the daemon says of a probe, which is no message of the probe's; that it stood
# still itself, beside other programs, among them.
OURS = ("status", "params", "log", "clock")

CONFIG = """
[zenoh]
history = 0
[log]
floor_mb = 0
"""

# Nothing says how much of the log is to be kept.
NOT_KEPT = {"reason": None, "files": None, "bytes": None}


def has_namespaces() -> bool:
    with contextlib.suppress(OSError):
        words = [*UNSHARE, "mount", "-t", "tmpfs", "none", "/mnt"]
        return subprocess.run(words, capture_output=True).returncode == 0
    return False


# Containers often forbid it.
needs_mounts = pytest.mark.skipif(
    not has_namespaces(), reason="file systems can't be mounted here (unshare)"
)


class Scene:
    """A daemon, a probe that streams into it, and what the network hears of both."""

    def __init__(self, directory: Path, daemon: DaemonProcess, port: Port) -> None:
        self.daemon = daemon
        self.port = port
        self.probe = FakeProbe()
        self.heard = 0
        self.notices: queue.Queue[dict[str, Any]] = queue.Queue()
        # The folder as the daemon sees it; held, it is there after the daemon's end.
        root = Path(f"/proc/{daemon.process.pid}/root")
        self.logs = root / (directory / "logs").relative_to("/")
        self.files = self.logs

    @contextlib.contextmanager
    def streaming(self) -> Iterator[Client]:
        self.daemon.expect("listens on")
        held = os.open(self.logs, os.O_DIRECTORY)
        self.files = Path(f"/proc/self/fd/{held}")
        self.port.wait_open()
        with Client(self.daemon.endpoint) as client:
            client.subscribe("log", None, lambda _, payload: self._take(payload))
            client.subscribe("pose", None, lambda *_: self._count())
            client.statuses()  # then the router knows both
            self.port.write(self.probe.say("hello"))
            self.daemon.expect("found")
            with Streaming(self.port, self.probe, say=self._said) as self.stream:
                yield client
            os.close(held)

    def _said(self) -> bytes:
        return self.port.answers(self.probe) + self.probe.say("pose")

    def _take(self, payload: bytes) -> None:
        self.notices.put(json.loads(payload))

    def _count(self) -> None:
        self.heard += 1

    def notice(self, state: str) -> dict[str, Any]:
        notice = self.notices.get()
        assert notice["state"] == state
        return notice

    def fill(self) -> Path:
        """Leaves no block free."""
        ballast = self.logs / "ballast"
        with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(1024))
        return ballast

    def end(self, client: Client) -> dict[str, Any]:
        """The status, when all that was sent is in its sinks."""
        self.stream.stop()
        while True:
            for status in client.statuses():
                ledger = status["ledger"]
                if ledger["published"].get("pose", 0) == self.stream.sent and not any(
                    sink["waiting"] for sink in ledger["sinks"].values()
                ):
                    return status
            time.sleep(0.05)


@contextlib.contextmanager
def scene(
    directory: Path, *, more: str = "", has_mount: bool = True
) -> Iterator[Scene]:
    (directory / "logs").mkdir()
    config = directory / "imud.toml"
    config.write_text(CONFIG + more)
    port = Port(directory / "probe")
    program = ("-m", "imud")
    if has_mount:
        program = (
            "-c",
            IN_A_NAMESPACE.format(unshare=UNSHARE, logs=str(directory / "logs")),
        )
    words = (port.path, "--config", config)
    with DaemonProcess(*words, directory=directory, program=program) as daemon:
        yield Scene(directory, daemon, port)
    port.vanish()


def check(made: Scene, client: Client, record: Record) -> None:
    """Whatever befell the log, nobody else felt it and nothing is unaccounted for."""
    status = made.end(client)
    ledger = status["ledger"]
    assert status["log"] == {"state": "on"} | NOT_KEPT
    assert ledger["adds_up"], ledger
    assert (ledger["lost"], ledger["corrupt"]) == (0, 0)
    assert ledger["dropped"]["zenoh"] == 0
    assert made.heard == ledger["published"]["pose"] == made.stream.sent
    dropped: int = ledger["dropped"]["log"]
    assert dropped > 0
    record("lost in the log", dropped)
    # Hello, pose and reply have bytes of their own.
    put = sum(n for topic, n in ledger["published"].items() if topic not in OURS)
    counted = sum(n for topic, n in ledger["logged"].items() if topic not in OURS)
    made.daemon.stop()
    found = [f for path in sorted(made.files.glob("*.mcap")) for f in frames(path)]
    assert len(found) == len(set(found))
    assert counted <= len(found) < put
    states = re.findall(r"log (failed|works)", "\n".join(made.daemon.lines))
    assert states == ["failed", "works"]


@needs_mounts
def test_a_full_disk_costs_what_comes_while_it_is_full(
    tmp_path: Path, record_property: Record
) -> None:
    with scene(tmp_path) as made, made.streaming() as client:
        ballast = made.fill()
        line = made.daemon.expect("log failed, retrying")
        assert os.strerror(errno.ENOSPC) in line
        paused = made.notice("paused")
        assert os.strerror(errno.ENOSPC) in paused["reason"]
        assert paused["probe"] == made.probe.name
        # The status of that second follows.
        while (log := client.statuses()[0]["log"])["state"] != "paused":
            pass
        assert os.strerror(errno.ENOSPC) in log["reason"]
        assert made.daemon.process.poll() is None
        ballast.unlink()
        watch = Stopwatch(made.daemon.process.pid)
        made.daemon.expect("log works again")
        again = made.notice("on")
        back_s = watch.look()
        assert back_s < 4.0  # tried each 2 s, told each second
        record_property("back after, s", back_s)
        assert again["reason"] is None
        assert again["dropped"] > paused["dropped"]
        check(made, client, record_property)


def test_a_probe_that_is_not_logged_says_so(tmp_path: Path) -> None:
    more = f"[probes.{FakeProbe().name}]\nlog = false\n"
    with (
        scene(tmp_path, more=more, has_mount=False) as made,
        made.streaming() as client,
    ):
        assert made.end(client)["log"] == {"state": "off"} | NOT_KEPT
        made.daemon.stop()
