# SPDX-License-Identifier: MIT
"""Ports are searched for probes: rates, ports of others, two ports with one id."""

from __future__ import annotations

import asyncio
import fcntl
import itertools
import logging
import os
import select
import time
from pathlib import Path

import pytest
import serial

from fakes import FakeProbe, Port, Stopwatch
from imud.config.settings import PortSettings
from imud.errors import PortLost
from imud.ports import baud, finder, link, port
from imud.ports.standing import is_candidate
from imud.probes.timeline import host_ns
from ports_desk import Desk, Device, at_desk


@pytest.mark.parametrize("baud", [500_000, 921_600, 115_200])
def test_a_probe_is_found_at_its_rate_wherever_it_is_plugged_in(
    tmp_path: Path, baud: int
) -> None:
    async def check(desk: Desk) -> None:
        probe = FakeProbe()
        port = desk.plug("ttyUSB0", baud)
        await desk.open_port(port)
        await desk.say_until_found(port, probe)
        assert port.speed == baud
        # Elsewhere: its rate is known, so that its first hello is understood.
        desk.unplug(port)
        await desk.until(lambda: desk.port_of(probe) is None)
        port = desk.plug("ttyUSB1", baud, hwid="USB VID:PID=1A86:7523 LOCATION=1-7")
        await desk.open_port(port)
        port.write(probe.say("hello"))
        await desk.until(lambda: desk.port_of(probe) == str(port.path))
        assert desk.found == [probe.name] * 2
        desk.unplug(port)

    at_desk(tmp_path, check, rates=(500_000, 921_600, 115_200))


def test_a_named_port_without_a_rate_is_tried_at_all_and_with_one_at_that(
    tmp_path: Path,
) -> None:
    first, second = Port(tmp_path / "a", 921_600), Port(tmp_path / "b", 230_400)

    async def check(desk: Desk) -> None:
        for each, identity in ((first, "00" * 8), (second, "11" * 8)):
            probe = FakeProbe(probe_id=bytes.fromhex(identity))
            await desk.open_port(each)
            await desk.say_until_found(each, probe)
        assert (first.speed, second.speed) == (921_600, 230_400)

    named = (str(first.path), f"{second.path}@230400")
    at_desk(tmp_path, check, find=False, named=named)
    first.vanish()
    second.vanish()


def test_a_virtual_probe_is_found_each_time_it_runs(tmp_path: Path) -> None:
    async def check(desk: Desk) -> None:
        for ignored in ("ignored", "imud-nano", "imud-nano"):
            probe, port = FakeProbe(), Port(tmp_path / ignored)
            desk.links = [tmp_path / "ignored", port.path]
            if ignored == "imud-nano":
                await desk.say_until_found(port, probe)
                assert [each.name for each in desk.finder] == [str(port.path)]
            port.vanish()
            await desk.until(lambda: not [*desk.finder])

    at_desk(tmp_path, check, find=True, ignore=("*/ignored",))


def test_nothing_is_written_to_a_port_before_a_hello(tmp_path: Path) -> None:
    port = Port(tmp_path / "modem")

    async def check(desk: Desk) -> None:
        await desk.open_port(port)
        (ours,) = desk.finder
        with pytest.raises(PortLost, match="no hello from a probe yet"):
            ours.write(b"x")
        port.write(b"OK\r\nRING\r\n" * 100)
        await desk.until(lambda: ours.baud == 921_600)
        with pytest.raises(PortLost, match="no hello from a probe yet"):
            ours.write(b"x")
        port.write(b"\0" + FakeProbe().say("hello"))
        await desk.until(lambda: desk.found)
        assert not select.select([port.master], [], [], 0)[0]
        ours.write(b"x")
        assert port.read() == b"x"

    at_desk(tmp_path, check, find=False, named=(str(port.path),))
    port.vanish()


def test_a_port_that_is_none_of_ours_is_given_back_at_once_and_tried_again_later(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, "imud")
    monkeypatch.setattr(finder, "PAUSE_S", 0.2)
    monkeypatch.setattr(finder, "LIST_S", 0.02)
    monkeypatch.setattr(baud, "QUIET_S", 0.1)
    opened: list[float] = []

    async def check(desk: Desk) -> None:
        port = desk.plug("ttyUSB0")
        for _ in range(4):
            await desk.open_port(port)
            opened.append(time.monotonic())
            await desk.until(lambda: not list(desk.finder))
            holder = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
            fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.close(holder)
        pauses = [b - a for a, b in itertools.pairwise(opened)]
        assert pauses[0] >= 0.2
        assert pauses[1] >= 0.4
        assert pauses[2] >= 0.8
        # Another probe comes to that port: it is tried at once.
        desk.unplug(port)
        await asyncio.sleep(0.1)  # it is seen to be gone
        port, probe = desk.plug("ttyUSB0"), FakeProbe()
        watch = Stopwatch()
        await desk.open_port(port)
        assert watch.look() < 0.8
        await desk.say_until_found(port, probe)
        desk.unplug(port)

    at_desk(tmp_path, check)
    lines = [r.getMessage() for r in caplog.records if "no probe detected" in r.msg]
    assert len(lines) == 1
    assert "at 500000 or 921600 baud; the port is closed for other programs" in lines[0]


def test_a_port_that_was_found_is_given_back_when_its_probe_falls_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    silent_s = 0.4
    monkeypatch.setattr(port, "SILENT_NS", int(silent_s * 1e9))
    monkeypatch.setattr(finder, "PAUSE_S", 0.1)
    monkeypatch.setattr(finder, "LIST_S", 0.02)

    async def check(desk: Desk) -> None:
        probe = FakeProbe()
        port = desk.plug("ttyUSB0")
        await desk.open_port(port)
        await desk.say_until_found(port, probe)
        # Whatever it says keeps the port, for longer than that.
        until_s = time.monotonic() + 3 * silent_s
        while time.monotonic() < until_s:  # what it says is heard
            port.write(probe.say("pose"))
            await asyncio.sleep(silent_s / 10)
            desk.finder.check(host_ns())
            assert desk.port_of(probe) == str(port.path)
        spoke_s = time.monotonic()
        while desk.port_of(probe) is not None:
            desk.finder.check(host_ns())
            await asyncio.sleep(0.01)
        assert time.monotonic() - spoke_s > silent_s * 0.8  # not sooner
        await desk.until(lambda: not list(desk.finder))
        # Another program can have it, and is not disturbed.
        holder = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
        fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        await asyncio.sleep(0.3)  # nothing is written
        assert not select.select([port.master], [], [], 0)[0]
        os.close(holder)
        # When it speaks again it is found again, with its account.
        await desk.open_port(port)
        await desk.say_until_found(port, probe)
        entry = desk.intake.registry.named(probe.name)
        assert entry.probe.account.boots == 1
        desk.unplug(port)

    at_desk(tmp_path, check)


def test_one_id_on_two_ports_is_told_and_not_merged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "imud")

    async def check(desk: Desk) -> None:
        probe, copy = FakeProbe(), FakeProbe(boot_count=3)
        first = desk.plug("ttyUSB0")
        await desk.open_port(first)
        await desk.say_until_found(first, probe)
        second = desk.plug("ttyUSB1")
        await desk.open_port(second)
        entry = desk.intake.registry.named(probe.name)
        before = entry.probe.account.counts()
        second.write(copy.say("hello") + copy.poses(50))
        await desk.until(lambda: "which is ignored" in caplog.text)
        assert desk.port_of(probe) == str(first.path)
        assert entry.probe.account.counts() == before
        others = [p for p in desk.finder if p.name == str(second.path)]
        with pytest.raises(PortLost):
            others[0].write(b"x")
        # The first one is gone: the other has its place from its next hello on.
        desk.unplug(first)
        await desk.until(lambda: desk.port_of(probe) is None)
        desk.finder.check(time.time_ns())
        await desk.say_until_found(second, copy)
        desk.unplug(second)

    at_desk(tmp_path, check)


def test_ports_named_anew_are_opened_and_others_closed(tmp_path: Path) -> None:
    first, second = Port(tmp_path / "a"), Port(tmp_path / "b")

    async def check(desk: Desk) -> None:
        await desk.open_port(first)
        desk.finder.configure(PortSettings(find=False, named=(str(second.path),)))
        await desk.open_port(second)
        await desk.until(lambda: [p.name for p in desk.finder] == [str(second.path)])

    at_desk(tmp_path, check, find=False, named=(str(first.path),))
    first.vanish()
    second.vanish()


def test_what_is_never_opened(tmp_path: Path) -> None:
    usb = Device("/dev/ttyUSB3")
    assert is_candidate(usb, ())
    assert is_candidate(Device("/dev/rfcomm0", hwid="n/a", vid=None), ())
    assert not is_candidate(Device("/dev/ttyS0", hwid="n/a", vid=None), ())
    assert not is_candidate(Device("/dev/ttyAMA0", hwid="n/a", vid=None), ())
    assert not is_candidate(usb, ("/dev/ttyUSB3",))
    assert not is_candidate(usb, ("/dev/ttyUSB*",))
    assert not is_candidate(usb, ("*VID:PID=1A86:7523*",))
    assert is_candidate(usb, ("/dev/ttyUSB4", "/dev/ttyACM*"))
    by_id = tmp_path / "by-id"
    by_id.symlink_to("/dev/ttyUSB3")
    assert not is_candidate(usb, (str(by_id),))


@pytest.mark.parametrize("has_reset", [False, True])
def test_dtr_is_toggled_when_told_and_else_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_reset: bool
) -> None:
    toggles: list[bool] = []
    own = property(lambda _: True, lambda _, is_active: toggles.append(is_active))
    monkeypatch.setattr(serial.Serial, "dtr", own)
    monkeypatch.setattr(link, "RESET_S", 0.001)
    port = Port(tmp_path / "port")

    async def check(desk: Desk) -> None:
        await desk.open_port(port)

    named = (str(port.path),)
    at_desk(tmp_path, check, find=False, named=named, reset=has_reset)
    assert toggles == ([False, True] if has_reset else [])
    port.vanish()
