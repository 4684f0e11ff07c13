# SPDX-License-Identifier: MIT
"""The cost of attackers for other clients: a daemon with keys, four probes at 200 Hz
and a subscriber over TLS, first alone, then beside all attacks of ATTACKS at once.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import random
import socket
import ssl
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import harness
from benchmarks.common.load import free_endpoint
from benchmarks.harness import Figure, Report, Table, ratio
from benchmarks.host.live import live
from imud.client import Client
from imud.errors import ImudError
from imud.net import keys

PROBES = 4
IDLE = 100  # connections of an attack that are held at a time
HOLD_S = 5.0
ALONE, ATTACKED = "alone", "under attack"
P99_RATIO = 2.0
LOGINS = 40

Address = tuple[str, int]


def hold(address: Address, first: bytes) -> None:
    """Connections that say little and wait."""
    with contextlib.ExitStack() as stack:
        for _ in range(IDLE):
            with contextlib.suppress(OSError):
                each = stack.enter_context(socket.create_connection(address, 2.0))
                each.sendall(first)
        time.sleep(HOLD_S)


def flood(address: Address, request: bytes) -> None:
    """Requests, one after the other, whose answers are not waited for."""
    until_s = time.monotonic() + HOLD_S
    while time.monotonic() < until_s:
        with (
            contextlib.suppress(OSError),
            socket.create_connection(address, 2.0) as each,
        ):
            each.sendall(request)
        time.sleep(0.005)


def noise(address: Address, _: bytes) -> None:
    """Bytes of chance."""
    chance = random.Random(1)  # noqa: S311
    flood(address, chance.randbytes(2000))


def hello() -> bytes:
    """The first record of a client of TLS."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    out = ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        context.wrap_bio(ssl.MemoryBIO(), out).do_handshake()
    return out.read()


def false_records(endpoint: Address, own: str, seconds: float) -> None:
    """Ten connections a second of that address: a true hello, and in the same segment
    data that no key has sealed.
    """
    until_s = time.monotonic() + seconds
    data = hello() + b"\x17\x03\x03\0\x20" + bytes(32)
    with contextlib.ExitStack() as stack:
        while time.monotonic() < until_s:
            with contextlib.suppress(OSError):
                each = socket.create_connection(endpoint, 2.0, (own, 0))
                stack.enter_context(each).sendall(data)
            time.sleep(0.1)


def logins(folder: Path, addresses: int) -> tuple[int, int]:
    """How many of LOGINS clients get in while so many addresses attack the TLS port."""
    ports = [int(free_endpoint().rpartition(":")[2]) for _ in range(3)]
    endpoint = f"tls/127.0.0.1:{ports[0]}"
    keys.initialise(folder / "keys", ["127.0.0.1"], ports[0])
    config = folder / "imud.toml"
    config.write_text(_guarded(folder, endpoint, ports))
    words = [sys.executable, "-m", "imud", "run", "--config", str(config)]
    daemon = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    viewer, admitted = folder / "keys" / "clients" / "viewer.toml", 0
    while not _gets_in(endpoint, viewer):
        time.sleep(0.1)
    strangers = [
        threading.Thread(
            target=false_records,
            args=(("127.0.0.1", ports[0]), f"127.0.0.{2 + number}", 30.0),
        )
        for number in range(addresses)
    ]
    for each in strangers:
        each.start()
    for _ in range(LOGINS):
        admitted += _gets_in(endpoint, viewer)
        time.sleep(0.5)
    for each in strangers:
        each.join()
    daemon.terminate()
    daemon.wait()
    return admitted, LOGINS


def _gets_in(endpoint: str, viewer: Path) -> bool:
    try:
        Client(endpoint, keys=viewer).close()
    except ImudError:
        return False
    return True


_GET = b"GET /%s HTTP/1.1\r\nHost: evil.example\r\n\r\n"
# Where: 0 the TLS port, 1 the page, 2 the metrics; how, and with which bytes.
ATTACKS: tuple[tuple[int, Callable[[Address, bytes], None], bytes], ...] = (
    (0, hold, b""),
    (0, hold, b"\x16\x03\x01\x02\x00" + bytes(100)),
    (0, flood, b"\x16\x03\x01\x00\x05\x01\x00\x00\x01\x00"),
    (0, noise, b""),
    (1, hold, b"GET / HTTP/1.1\r\n"),
    (1, flood, _GET % b""),
    (1, noise, b""),
    (2, flood, _GET % b"metrics"),
    (2, hold, b"GET"),
)


def attack(addresses: Sequence[Address], seconds: float) -> None:
    """All of them, again and again, each in a thread.

    They have the processor when nobody else wants it (sched(7), SCHED_IDLE; with a nice
    value of 19 they keep it until the next tick, 4 ms): strangers have one of their
    own, and what is measured is the daemon's work with them.
    """
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    until_s = time.monotonic() + seconds

    def again(where: int, how: Callable[[Address, bytes], None], data: bytes) -> None:
        while time.monotonic() < until_s:
            how(addresses[where], data)

    threads = [threading.Thread(target=again, args=each) for each in ATTACKS]
    for each in threads:
        each.start()
    for each in threads:
        each.join()


def run(seconds: float, folder: Path, *, is_attacked: bool) -> dict[str, Any]:
    """A daemon with keys, its probes and subscriber, and maybe attackers."""
    ports = [int(free_endpoint().rpartition(":")[2]) for _ in range(3)]
    endpoint = f"tls/127.0.0.1:{ports[0]}"
    keys.initialise(folder / "keys", ["127.0.0.1"], ports[0])
    config = folder / "imud.toml"

    def command(names: list[str]) -> list[str]:
        named = f"[ports]\nfind = false\nnamed = {names}\n"
        config.write_text(named + _guarded(folder, endpoint, ports))
        return ["-m", "imud", "run", "--config", str(config)]

    addresses = [("127.0.0.1", port) for port in ports]
    spawn = multiprocessing.get_context("spawn")
    attacker = spawn.Process(target=attack, args=(addresses, seconds))
    viewer = folder / "keys" / "clients" / "viewer.toml"
    beside = attacker if is_attacked else None
    found = live(PROBES, seconds, folder, endpoint, command, keys=viewer, beside=beside)
    memory, files = zip(*found.pop("watched"), strict=True)
    return found | {"memory": _quarters(memory), "files": (files[0], max(files))}


def _quarters(values: Sequence[float]) -> list[float]:
    """At the start, at each quarter, and at most: what grows does so in all of them."""
    last = len(values) - 1
    return [*(values[last * part // 4] for part in range(5)), max(values)]


def _guarded(folder: Path, endpoint: str, ports: Sequence[int]) -> str:
    """Settings of a daemon with keys, a page and metrics."""
    return (
        f"[zenoh]\nlisten = ['{endpoint}']\nkeys = '{folder / 'keys'}'\n"
        f"[web]\nlisten = '127.0.0.1:{ports[1]}'\n"
        f"[metrics]\nlisten = '127.0.0.1:{ports[2]}'\n"
        f"[log]\ndir = '{folder / 'logs'}'\n"
    )


def table_of(runs: Mapping[str, dict[str, Any]]) -> Table:
    columns = {"": "", "minutes": ".0f", "poses": ",d", "lost": ",d"}
    columns |= {"median, us": ",.0f", "p99, us": ",.0f"}
    columns |= {"memory at start, quarters, most, MiB": "", "files": ""}
    rows = [
        (
            *(name, each["seconds"] / 60.0, each["poses_sent"], each["lost"]),
            *(each["median_us"], each["p99_us"]),
            ", ".join(f"{mib:.0f}" for mib in each["memory"]),
            "{} to {}".format(*each["files"]),
        )
        for name, each in runs.items()
    ]
    return Table("clients", columns, rows)


def figures_of(runs: Mapping[str, dict[str, Any]]) -> Iterator[Figure]:
    """A stranger may cost no pose, and may no more than double the 99th percentile."""
    alone = runs[ALONE]
    for name, each in runs.items():
        if name != ALONE:
            yield Figure(f"{name}: poses lost", each["lost"], (0, 0), (0, 0))
            p99s = each["p99_us"], alone["p99_us"]
            yield ratio(f"{name}: p99 over alone", *p99s, P99_RATIO, P99_RATIO)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--minutes", type=float, default=60.0, help="of attacks")


def measured(args: argparse.Namespace) -> Report:
    """A minute alone, then under attack."""
    runs = {}
    for name, minutes in ((ALONE, min(1.0, args.minutes)), (ATTACKED, args.minutes)):
        with tempfile.TemporaryDirectory() as folder:
            is_attacked = name == ATTACKED
            runs[name] = run(60.0 * minutes, Path(folder), is_attacked=is_attacked)
    table, figures = table_of(runs), [*figures_of(runs)]
    for addresses in (1, 2, 3):
        with tempfile.TemporaryDirectory() as folder:
            admitted, of = logins(Path(folder), addresses)
        runs[f"logins beside {addresses}"] = {"admitted": admitted, "of": of}
        name = f"logins beside {addresses} attacking addresses, %"
        figures.append(Figure(name, 100.0 * admitted / of, (95, 100), (99, 100)))
    return Report([table], figures, runs)


main = partial(harness.run, "attacks", __doc__, measured, options)
