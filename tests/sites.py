# SPDX-License-Identifier: MIT
"""Hosts of several sites: network namespaces, joined by one that routes between them.

Each host has one address. Packets that the namespace in the middle does not forward are
lost silently, as on a broken line.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

import pytest

from fakes import DaemonProcess, FakeProbe, Port
from streaming import Process, Streaming

FLEET = Path(__file__).resolve().parent.parent / "docs" / "fleet.md"

FORWARD = "net.ipv4.ip_forward=1"

# A router as docs/fleet.md configures it; zenohd reads the same file.
ROUTER = """
import sys, zenoh
session = zenoh.open(zenoh.Config.from_file(sys.argv[1]))
print("up", flush=True)
sys.stdin.read()
"""

# A subscriber that tells at each line of its input what it has got so far.
CONSUMER = """
import json, sys, threading, imud
numbers = {}
poses = imud.subscribe(endpoint=sys.argv[1])
print("up", flush=True)
def hear():
    for pose in poses:
        numbers.setdefault(pose.probe, []).append(pose.number)
threading.Thread(target=hear, daemon=True).start()
for _ in sys.stdin:
    counts = {
        probe: {
            "first": heard[0],
            "last": heard[-1],
            "got": len(heard),
            "is_rising": heard == sorted(set(heard)),
            "missed": poses.missed_of(probe, "pose").network,
            "restarts": poses.missed_of(probe, "pose").daemon_restarts,
        }
        for probe, heard in list(numbers.items())
    }
    print(json.dumps(counts), flush=True)
"""


def configuration(name: str, addresses: dict[str, str], directory: Path) -> Path:
    """Writes a configuration of docs/fleet.md to a file, with addresses for names."""
    found = re.search(
        rf"^```\w+\n(?:#|//) {re.escape(name)}\n(.*?)^```",
        FLEET.read_text(),
        re.M | re.S,
    )
    assert found is not None, f"docs/fleet.md has no {name}"
    text = found[1]
    for host, address in addresses.items():
        text = text.replace(f"{host}.example.org", address)
    assert "example.org" not in text
    path = directory / name
    path.write_text(text, "utf-8")
    return path


class Lab:
    """Hosts by name. `with` removes them and ends what runs there."""

    def __init__(self, *names: str) -> None:
        self._mark = f"imud{os.getpid()}"
        self._made: list[str] = []
        self.processes: list[Node | DaemonProcess] = []
        self.addresses: dict[str, str] = {}
        if shutil.which("ip") is None or not self._is_added("wan"):
            # A container may forbid them: docs/limits.md.
            pytest.skip("needs root and `ip netns`: network namespaces can't be made")
        self._wan("link", "set", "lo", "up")
        self._run("netns", "exec", self.of("wan"), "sysctl", "-qw", FORWARD)
        for number, name in enumerate(names, 1):
            assert self._is_added(name)
            self._join(name, number)

    def _join(self, name: str, number: int) -> None:
        """Gives a host its link and address."""
        here, link = self.of(name), f"p{number}"
        ends = ("netns", here, "type", "veth", "peer", "name", link)
        self._run("link", "add", "w0", *ends, "netns", self.of("wan"))
        address, gateway = f"10.77.{number}.2", f"10.77.{number}.1"
        self._run("-n", here, "addr", "add", f"{address}/30", "dev", "w0")
        self._wan("addr", "add", f"{gateway}/30", "dev", link)
        self._wan("link", "set", link, "up")
        for device in ("lo", "w0"):
            self._run("-n", here, "link", "set", device, "up")
        self._run("-n", here, "route", "add", "default", "via", gateway)
        self.addresses[name] = address

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self.processes):
            process.__exit__(None, None, None)
        for name in self._made:
            subprocess.run(("ip", "netns", "del", name), check=False)

    def of(self, name: str) -> str:
        """The namespace of a host."""
        return f"{self._mark}-{name}"

    def _is_added(self, name: str) -> bool:
        made = subprocess.run(
            ("ip", "netns", "add", self.of(name)), capture_output=True, check=False
        )
        if made.returncode == 0:
            self._made.append(self.of(name))
        return made.returncode == 0

    def _run(self, *words: str) -> None:
        subprocess.run(("ip", *words), check=True)

    def _wan(self, *words: str) -> None:
        self._run("-n", self.of("wan"), *words)

    def cut(self, sender: str, receiver: str) -> None:
        """From here on nothing of the sender reaches the receiver."""
        self._wan("rule", "add", *self._way(sender, receiver))

    def heal(self, sender: str, receiver: str) -> None:
        self._wan("rule", "del", *self._way(sender, receiver))

    def _way(self, sender: str, receiver: str) -> tuple[str, ...]:
        way = ("from", self.addresses[sender], "to", self.addresses[receiver])
        return (*way, "blackhole", "priority", "100")

    def inside(self, host: str) -> tuple[str, ...]:
        """The prefix of a command that runs on a host."""
        return ("ip", "netns", "exec", self.of(host))

    def node(self, host: str, *arguments: object) -> Node:
        made = Node(*self.inside(host), sys.executable, *map(str, arguments))
        self.processes.append(made)
        return made

    def router(self, host: str, path: Path) -> Node:
        node = self.node(host, "-c", ROUTER, path)
        assert node.line() == "up"
        return node

    def consumer(self, host: str, router: str) -> Node:
        endpoint = f"tcp/{self.addresses[router]}:7447"
        node = self.node(host, "-c", CONSUMER, endpoint)
        assert node.line() == "up"
        return node

    def recorder(self, host: str, router: str, directory: Path) -> Node:
        where = ("--connect", f"tcp/{self.addresses[router]}:7447")
        what = ("-m", "imud", "record", "--json", "--log", directory)
        node = self.node(host, *what, *where)
        assert "records to" in node.line(is_error=True)
        return node


class Node(Process):
    """A process on a host."""

    def __init__(self, *command: str) -> None:
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def line(self, *, is_error: bool = False) -> str:
        stream = self.process.stderr if is_error else self.process.stdout
        return stream.readline().rstrip("\n")

    def finish(self) -> dict[str, Any]:
        """Ends a recorder; what it says then."""
        self.process.send_signal(signal.SIGTERM)
        out, _ = self.process.communicate()
        return json.loads(out)

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


class Desk:
    """A daemon on a host of a site, with one probe that streams."""

    def __init__(self, lab: Lab, host: str, path: Path, number: int) -> None:
        directory = path.parent / host
        directory.mkdir()
        self.probe = FakeProbe(probe_id=bytes([0xFE, 0, 0, 0, 0, 0, 0, number]))
        self.port = Port(directory / "port")
        self.spare = directory / "spare"  # a port where another probe may come
        self.daemon = DaemonProcess(
            *(self.port.path, self.spare, "--config", path),
            directory=directory,
            log=False,
            endpoint="tcp/127.0.0.1:7447",  # a client listens nowhere
            before=lab.inside(host),
        )
        lab.processes.append(self.daemon)
        self.daemon.find(self.port, self.probe, up="connects to")
        self.stream = Streaming(self.port, self.probe, period_s=0.02)

    @property
    def name(self) -> str:
        return self.probe.name

    def __exit__(self, *_: object) -> None:
        self.stream.stop()
        self.port.vanish()
