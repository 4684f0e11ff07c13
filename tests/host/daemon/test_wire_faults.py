# SPDX-License-Identifier: MIT
"""Wires that are pulled, boards that reset, daemons that start twice: what was lost is
on record, and poses are back in under 2 s. The figures of docs/limits.md are the
properties that these tests record: pytest -o junit_family=xunit1 --junitxml FILE.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import DaemonProcess, FakeProbe, Port, Stopwatch
from imud.daemon.commands import REPLY_TIMEOUT_S
from imud.probes.ledger import totals

BACK_S = 2.0

# Number of places in a frame at which the wire is pulled, besides both of its ends.
PLACES = 12

# Between two messages of a probe that streams.
STREAM_S = 0.01

Record = Callable[[str, object], None]


class Bench(Chain):
    """A probe, its port, a daemon, and the poses that a subscriber hears."""

    def __init__(self, directory: Path, settings: str = "") -> None:
        file = directory / "imud.toml"
        file.write_text(settings)
        super().__init__(directory, "--config", file, log=False)
        self.poses, self.statuses = self.hear("pose"), self.hear("status")

    def pose(self, sequence: int) -> None:
        """Waits for it."""
        while json.loads(self.poses.get())["seq"] != sequence:
            pass

    def ledger(self, received: int) -> dict[str, Any]:
        """The ledger of the first status with that many messages of all boots."""
        while True:
            ledger: dict[str, Any] = json.loads(self.statuses.get())["ledger"]
            if totals(ledger).received >= received:
                assert totals(ledger).received == received
                return ledger

    def replug(self, *, after_s: float = 0.0) -> None:
        self.port.vanish()
        time.sleep(after_s)  # so long it is unplugged
        self.port = Port(self.port.path)

    def come_back(self, sent: bytes) -> float:
        """Seconds until the pose that ends these bytes is published."""
        watch = Stopwatch(self.daemon.process.pid)
        self.port.wait_open()
        self.port.write(sent)
        self.pose(self.probe.sequence - 1)
        return watch.look()


@contextlib.contextmanager
def bench(directory: Path, settings: str = "") -> Iterator[Bench]:
    made = Bench(directory, settings)
    try:
        yield made
    finally:
        made.close()


def report(record: Record, lost: object, back_s: float) -> None:
    record("lost", lost)
    record("back after, s", round(back_s, 3))
    assert back_s < BACK_S


def test_a_wire_pulled_at_any_byte_costs_that_frame_and_is_back_in_2_s(
    tmp_path: Path, record_property: Record
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
        report(record_property, "the frame in which it struck", slowest_s)


def test_what_was_sent_while_unplugged_is_missing_in_the_next_pose(
    tmp_path: Path, record_property: Record
) -> None:
    with bench(tmp_path) as desk:
        before = desk.probe.sequence
        desk.replug(after_s=0.3)
        lost = desk.probe.poses(60)
        assert lost
        back_s = desk.come_back(desk.probe.say("hello") + desk.probe.poses(2))
        assert desk.ledger(before + 3)["lost"] == 60
        report(record_property, "60 of the 60 sent meanwhile", back_s)


def test_a_reset_in_mid_frame_costs_that_frame_and_is_a_boot_of_its_own(
    tmp_path: Path, record_property: Record
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
            # Each torn frame is one corrupt frame; its number was never received.
            assert ledger["corrupt"] == resets
            assert totals(ledger).lost == 0
        assert ledger["boots"] == 4
        report(record_property, "the frame in which it struck", slowest_s)


def test_a_brown_out_is_told_with_its_cause(
    tmp_path: Path, record_property: Record
) -> None:
    with bench(tmp_path) as desk:
        desk.port.write(desk.probe.poses(20) + desk.probe.say("pose")[:9])
        received = desk.probe.sequence - 1
        desk.probe.restart()
        desk.probe.hello_fields = desk.probe.hello_fields | {
            "reset_cause": ("brown_out",)
        }
        desk.probe.time_us = 1000
        # The delimiter that a boot begins with ends the torn frame.
        back_s = desk.come_back(
            b"\0" + desk.probe.say("hello") + desk.probe.say("pose")
        )
        desk.daemon.expect(r"restarted on .* boot 8 \(brown out\)")
        ledger = desk.ledger(received + 2)
        assert (ledger["boots"], ledger["corrupt"], ledger["lost"]) == (2, 1, 0)
        report(record_property, "the frame in which it struck", back_s)


OWN = """
[probes.00112233445566aa]
pose_rate = 50
streams = ["pose"]
start = true
"""
ORDERS = [("rate", (0, 50)), ("fields", (1, 0)), ("start", (0, 0))]


def test_a_probes_own_settings_are_applied_whenever_it_appears(
    tmp_path: Path, record_property: Record
) -> None:
    """At first, after a replug, after a reset and after a brown-out."""
    with bench(tmp_path, OWN) as desk:

        def obeyed() -> float:
            watch = Stopwatch(desk.daemon.process.pid)
            desk.port.serve(desk.probe, len(ORDERS))
            heard = [(c["command"], c["arguments"]) for c in desk.probe.commands]
            desk.probe.commands.clear()
            assert heard == ORDERS
            back_s = watch.look()
            # Behind its last answer: with this pose, that has come.
            desk.port.write(desk.probe.say("pose"))
            desk.pose(desk.probe.sequence - 1)
            return back_s

        obeyed()  # late: it was not let answer while the bench was set up
        slowest_s = 0.0
        for turn in range(6):
            if turn % 2:
                desk.probe.restart()
                desk.probe.time_us = 1000 * turn
            else:
                desk.replug()
            sent = desk.probe.say("hello") + desk.probe.say("pose")
            slowest_s = max(slowest_s, desk.come_back(sent) + obeyed())
        report(record_property, 0, slowest_s)
        # The wire is pulled before it has answered: everything restarts, at once.
        desk.replug()
        desk.come_back(desk.probe.say("hello") + desk.probe.say("pose"))
        assert desk.port.read()
        desk.replug()
        sent = desk.probe.say("hello") + desk.probe.say("pose")
        assert desk.come_back(sent) + obeyed() < REPLY_TIMEOUT_S
        # A probe that will not is told, and continues as it is.
        desk.probe.results["rate"] = "bad_argument"
        desk.replug()
        desk.come_back(desk.probe.say("hello") + desk.probe.say("pose"))
        desk.port.serve(desk.probe, 1)
        desk.daemon.expect("its settings can't be applied: .* refused rate")
        desk.port.write(desk.probe.say("pose"))
        desk.pose(desk.probe.sequence - 1)


def test_a_second_start_while_it_streams_is_back_in_2_s(
    tmp_path: Path, record_property: Record
) -> None:
    """In the probe's time, which a busy machine slows down as it does the daemon."""
    probe, port = FakeProbe(), Port(tmp_path / "port")
    os.set_blocking(port.master, False)
    ended = threading.Event()

    def stream() -> None:
        while not ended.wait(STREAM_S):
            is_due = probe.sequence % 100 == 0
            # Bytes without a reader are lost.
            with contextlib.suppress(BlockingIOError):
                port.write(probe.say("hello") if is_due else probe.say("pose"))

    streamer = threading.Thread(target=stream, daemon=True)
    streamer.start()
    slowest_s = 0.0
    try:
        for _ in range(3):
            with DaemonProcess(port.path, directory=tmp_path, log=False) as daemon:
                daemon.expect("listens on")
                begin = probe.sequence
                daemon.expect("found on")
                slowest_s = max(slowest_s, STREAM_S * (probe.sequence - begin))
                daemon.process.kill()
    finally:
        ended.set()
        streamer.join()
        port.vanish()
    assert not probe.commands
    report(record_property, "what was sent while none ran", slowest_s)


def resident_kb(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    (line,) = (line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1])


@pytest.mark.nightly
def test_a_hundred_reconnects_leak_no_descriptor_and_no_memory(
    tmp_path: Path, record_property: Record
) -> None:
    with bench(tmp_path) as desk:
        pid = desk.daemon.process.pid
        folder = Path(f"/proc/{pid}/fd")
        descriptors: list[int] = []
        resident: list[int] = []
        slowest_s = 0.0
        for _ in range(100):
            desk.replug()
            sent = desk.probe.say("hello") + desk.probe.say("pose")
            slowest_s = max(slowest_s, desk.come_back(sent))
            descriptors.append(len(list(folder.iterdir())))
            resident.append(resident_kb(pid))
        assert desk.ledger(desk.probe.sequence)["lost"] == 0
        assert descriptors[-1] <= max(descriptors[:10])
        # A session and its decoder are 10 kB: a leak of all of them would be 900.
        assert resident[-1] - resident[10] < 500
        record_property(
            "descriptors, first and last", (descriptors[0], descriptors[-1])
        )
        record_property("memory, kB more", resident[-1] - resident[10])
        report(record_property, 0, slowest_s)
