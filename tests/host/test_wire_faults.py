# SPDX-License-Identifier: MIT
"""Wires that are pulled, boards that reset, daemons that start twice: what was lost is
on record, and poses are back in under 2 s.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port
from imud.client import Client

BACK_S = 2.0

# The wire is pulled at so many places of a frame, and at both of its ends.
PLACES = 12


class Bench:
    """A probe, its port, a daemon, and the poses that a subscriber hears."""

    def __init__(self, directory: Path) -> None:
        self.probe = FakeProbe()
        self.port = Port(directory / "port")
        self.daemon = DaemonProcess(self.port.path, directory=directory, log=False)
        self.daemon.expect("listens on")
        self.port.wait_open()
        self.port.write(self.probe.say("hello"))
        self.daemon.expect("found on")
        self.client = Client(self.daemon.endpoint)
        self.client.wait_for(seconds=PATIENCE_S)
        self.poses = self.hear("pose")
        self.statuses = self.hear("status")
        while self.poses.empty():  # until the daemon knows of the subscriber
            self.port.write(self.probe.say("pose"))
            time.sleep(0.05)
        self.pose(self.probe.sequence - 1)

    def hear(self, topic: str) -> queue.Queue[dict[str, Any]]:
        heard: queue.Queue[dict[str, Any]] = queue.Queue()
        self.client.subscribe(topic, None, lambda _, data: heard.put(json.loads(data)))
        return heard

    def pose(self, sequence: int) -> dict[str, Any]:
        while True:
            pose = self.poses.get(timeout=PATIENCE_S)
            if pose["seq"] == sequence:
                return pose

    def ledger(self, received: int) -> dict[str, Any]:
        """Of the first status in which so many messages of all boots are."""
        while True:
            ledger = self.statuses.get(timeout=PATIENCE_S)["ledger"]
            earlier = ledger["earlier_boots"]
            if ledger["received"] + earlier["received"] >= received:
                assert ledger["received"] + earlier["received"] == received
                return dict(ledger)

    def replug(self, *, after_s: float = 0.0) -> None:
        self.port.vanish()
        time.sleep(after_s)
        self.port = Port(self.port.path)

    def come_back(self, sent: bytes) -> float:
        """Seconds until the pose that ends these bytes is published."""
        begin = time.monotonic()
        self.port.wait_open()
        self.port.write(sent)
        self.pose(self.probe.sequence - 1)
        return time.monotonic() - begin

    def close(self) -> None:
        self.client.close()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


@contextmanager
def bench(directory: Path) -> Iterator[Bench]:
    made = Bench(directory)
    try:
        yield made
    finally:
        made.close()


def test_a_wire_pulled_at_any_byte_costs_that_frame_and_is_back_in_2_s(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as desk:
        frame_bytes = len(FakeProbe().say("pose"))
        places = range(0, frame_bytes, frame_bytes // PLACES)
        received, slowest_s = desk.probe.sequence, 0.0
        for place in sorted({0, frame_bytes - 1, *places}):
            whole, torn = desk.probe.say("pose"), desk.probe.say("pose")
            desk.port.write(whole + torn[:place])
            desk.pose(desk.probe.sequence - 2)
            desk.replug()
            hello, pose = desk.probe.say("hello"), desk.probe.say("pose")
            slowest_s = max(slowest_s, desk.come_back(torn[place:] + hello + pose))
            received += 4 if place == 0 else 3
            ledger = desk.ledger(received)
            assert ledger["sent"] == desk.probe.sequence
            assert ledger["lost"] == desk.probe.sequence - received
        assert slowest_s < BACK_S


def test_what_was_sent_while_unplugged_is_missing_in_the_next_pose(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as desk:
        before = desk.probe.sequence
        desk.replug(after_s=0.3)
        lost = desk.probe.poses(60)
        assert lost
        assert desk.come_back(desk.probe.say("hello") + desk.probe.poses(2)) < BACK_S
        assert desk.ledger(before + 3)["lost"] == 60


def test_a_reset_in_mid_frame_costs_that_frame_and_is_a_boot_of_its_own(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as desk:
        received, slowest_s = desk.probe.sequence, 0.0
        for resets, place in enumerate((1, 7, 33), start=1):
            torn = desk.probe.say("pose")[:place]
            desk.probe.restart()
            desk.probe.time_us = 1000 * resets  # no two boots say the same
            # Its bytes end where it struck; the first frame after it is glued to them.
            sent = torn + desk.probe.say("hello") + desk.probe.say("pose")
            sent += desk.probe.say("hello") + desk.probe.say("pose")
            slowest_s = max(slowest_s, desk.come_back(sent))
            desk.daemon.expect("restarted on")
            received += 3
            ledger = desk.ledger(received)
            # What was torn is one bad frame; its number was never heard.
            assert ledger["corrupt"] == resets
            assert ledger["earlier_boots"]["lost"] + ledger["lost"] == 0
        assert ledger["boots"] == 4
        assert slowest_s < BACK_S


def test_a_second_start_while_it_streams_is_back_in_2_s(tmp_path: Path) -> None:
    probe, port = FakeProbe(), Port(tmp_path / "port")
    ended = threading.Event()

    def stream() -> None:
        while not ended.wait(0.01):
            is_due = probe.sequence % 100 == 0
            port.write(probe.say("hello") if is_due else probe.say("pose"))

    streamer = threading.Thread(target=stream, daemon=True)
    streamer.start()
    try:
        for _ in range(3):
            with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
                daemon.expect("listens on")
                begin = time.monotonic()
                daemon.expect("found on")
                assert time.monotonic() - begin < BACK_S
                daemon.process.kill()
    finally:
        ended.set()
        streamer.join()
        port.vanish()
    assert not probe.commands


def resident_kb(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1])


def test_a_hundred_reconnects_leak_no_descriptor_and_no_memory(tmp_path: Path) -> None:
    with bench(tmp_path) as desk:
        pid = desk.daemon.process.pid
        folder = Path(f"/proc/{pid}/fd")
        descriptors: list[int] = []
        resident: list[int] = []
        for _ in range(100):
            desk.replug()
            sent = desk.probe.say("hello") + desk.probe.say("pose")
            assert desk.come_back(sent) < BACK_S
            descriptors.append(len(list(folder.iterdir())))
            resident.append(resident_kb(pid))
        assert desk.ledger(desk.probe.sequence)["lost"] == 0
        assert descriptors[-1] <= max(descriptors[:10])
        # A session and its decoder are 10 kB: a leak of all of them would be 900.
        assert resident[-1] - resident[10] < 500


def test_a_second_daemon_on_a_port_says_one_line_and_the_first_goes_on(
    tmp_path: Path,
) -> None:
    with bench(tmp_path) as desk:
        with DaemonProcess(desk.port.path, directory=tmp_path, log=False) as second:
            second.expect("port is held by another program; it is taken up when")
            desk.port.write(desk.probe.poses(50))
            desk.pose(desk.probe.sequence - 1)
            time.sleep(1.0)  # it tries again, and again in vain
            second.stop()
            assert sum("held by" in line for line in second.lines) == 1
        desk.port.write(desk.probe.poses(50))
        desk.pose(desk.probe.sequence - 1)
        assert desk.ledger(desk.probe.sequence)["lost"] == 0
