# SPDX-License-Identifier: MIT
"""The whole chain: image, emulator, pty, daemon, subscriber, log."""

from __future__ import annotations

import queue
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import reference
from demanded import BUILT
from fakes import PATIENCE_S, SOON_S, DaemonProcess, Port
from imud import _core
from imud.client import Client
from imud.recordings import decode
from imud.wire import schema
from imud.wire.messages import Message
from imud.wire.messages import decode as decode_content
from length import choose
from system.live import LiveProbe, hear, take
from system.virtual import Stub, run

pytestmark = pytest.mark.sampled(2)

CLICK = ("--press", "200000:300000")


def drained(heard: queue.Queue[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    while not heard.empty():
        yield heard.get()


def damage(data: bytes, seed: int) -> bytes:
    """Drops, doubles and flips bytes, but for the first and the last 4000."""
    chance = np.random.default_rng(seed)
    head, middle, tail = data[:4000], data[4000:-4000], data[-4000:]
    worse = bytearray()
    for byte, luck in zip(middle, chance.random(len(middle)), strict=True):
        if luck < 0.0005:
            continue
        worse.append(byte ^ (1 << chance.integers(8)) if luck < 0.0010 else byte)
        if luck > 0.9995:
            worse.append(byte)
    return head + bytes(worse) + tail


def passed_on(ledger: dict[str, Any]) -> list[int]:
    """Messages of the probe that were published and logged."""
    own = ("status", "params")  # the daemon's, beside the probe's of these names
    return [
        sum(count for topic, count in ledger[sink].items() if topic not in own)
        for sink in ("published", "logged")
    ]


@pytest.mark.long
@pytest.mark.parametrize("seed", choose(everyday=[1], long=[1, 2, 3]))
def test_damage_on_the_wire_adds_up_to_the_frame(stub: Stub, seed: int) -> None:
    done = run(stub, 12, *CLICK, *stub.raw_too)
    whole = set(done.contents)
    # One in 65536 damaged frames has a good CRC, which two times in a row is no chance.
    for each in (seed, seed + 10):
        received = damage(done.record.read_bytes(), each)
        good = reference.contents(received)
        if set(good) <= whole:
            break
    assert set(good) <= whole, "damaged frames pass as good"
    port = Port(stub.folder / "port")
    with DaemonProcess(port.path, directory=stub.folder) as daemon:
        port.wait_open()
        with Client(daemon.endpoint) as client:
            # In pieces that no kernel buffer refuses; the daemon reads as they come.
            for at in range(0, len(received), 2048):
                port.write(received[at : at + 2048])
            statuses = hear(client, "status")
            last = done.messages[-1].sequence
            while True:
                ledger = statuses.get(timeout=PATIENCE_S)["ledger"]
                if ledger["sent"] == last + 1 and passed_on(ledger) == [len(good)] * 2:
                    break
        assert daemon.stop() < SOON_S
    assert ledger["sent"] == done.summary["frames"]
    assert ledger["received"] == len(good)
    assert ledger["lost"] == done.summary["frames"] - len(good)
    assert ledger["lost"] > 50
    assert ledger["skewed"] == {}
    logged = [
        item
        for item in decode.decode_file(daemon.log, decode.Tally())
        if item["type"] == "pose"
    ]
    named = [decode_content(content) for content in good]
    poses = [m.sequence for m in named if isinstance(m, Message) and m.name == "pose"]
    assert [item["seq"] for item in logged] == poses
    assert ledger["published"]["pose"] == ledger["logged"]["pose"] == len(poses)
    port.vanish()


@pytest.mark.parametrize("stub", BUILT, indirect=True)
def test_a_live_probe_reaches_a_subscriber_with_nothing_lost(stub: Stub) -> None:
    probe = LiveProbe(stub, "--press", "1500000:1700000")
    with DaemonProcess(probe.port, directory=stub.folder) as daemon:
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            name = client.wait_for(seconds=PATIENCE_S)
            poses = hear(client, "pose")
            got = take(poses, 300)
            assert client.command(name, "stop")["ok"]
            got += list(drained(poses))
            (status,) = client.statuses()
        summary = probe.end()
        daemon.stop()
    assert not summary["crashed"]
    assert summary["late"] == 0
    assert status["ledger"]["lost"] == 0
    assert status["ledger"]["corrupt"] == 0
    numbers = [pose["seq"] for pose in got]
    steps = np.diff([pose["t_device_us"] for pose in got])
    assert np.all(np.abs(steps - 10_000) < stub.board.unevenness_us)
    assert numbers == sorted(numbers)
    assert set(got[0]) == {
        *("type", "probe", "seq", "number", "missing", "t_device_us", "t_ns"),
        *("t_bound_us", "age_us", "q", "position_m", "normal", "tilt_sigma_deg"),
        *("heading_sigma_deg", "flags", "since_origin", "utc_host", "utc_bound_us"),
    }


@pytest.mark.nightly
def test_a_yanked_probe_is_found_again_under_its_own_name(stub: Stub) -> None:
    memory = ("--eeprom", stub.folder / "memory")
    probe = LiveProbe(stub, *memory)
    with DaemonProcess(probe.port, directory=stub.folder) as daemon:
        first = daemon.expect("found on")
        probe.end()
        daemon.expect(re.escape(str(probe.port)))
        probe = LiveProbe(stub, *memory)
        again = daemon.expect("found on|is back|restarted|boot")
        with Client(daemon.endpoint) as client:
            name = client.wait_for(seconds=PATIENCE_S)
        assert name in first
        assert name in again
        probe.end()
        daemon.stop()


def test_a_probe_that_a_host_cannot_read_is_named_once(stub: Stub) -> None:
    done = run(stub, 3)
    hello = next(c for c in done.contents if c[0] == reference.HELLO_ID)
    changed = hello.replace(
        schema.FINGERPRINT.to_bytes(4, "little"), (0x12345678).to_bytes(4, "little")
    )
    assert changed != hello
    port = Port(stub.folder / "port")
    with DaemonProcess(port.path, directory=stub.folder) as daemon:
        port.wait_open()
        port.write(_core.encode_frame(0xFFFF, changed) * 3)
        line = daemon.expect("schema")
        daemon.stop()
        assert "0x12345678" in line
        assert sum("schema" in each for each in daemon.lines) == 1
    port.vanish()
