# SPDX-License-Identifier: MIT
"""Only ports that are ours are opened: a probe was heard there, or a person said so."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fakes import FakeProbe, Port
from imud.config.settings import PortSettings
from imud.errors import FileError
from imud.ports import finder, link
from imud.ports.adapters import ADAPTERS, adapter_of, kind_of, table
from imud.ports.adopted import AdoptedPorts, is_unique
from imud.ports.standing import Standing, rows, standing_of
from ports_desk import Desk, Device, at_desk

ROOT = Path(__file__).resolve().parents[3]

SECONDS = float(os.environ.get("IMU_NEIGHBOUR_SECONDS", "1.5"))

# Reads lines from a port as a serial monitor does, and reports what it received.
OTHER = """
import hashlib, os, sys, tty
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
print("open", flush=True)
data, count, digest = b"", 0, hashlib.sha256()
while True:
    *lines, data = (data + os.read(port, 65536)).split(b"\\n")
    for line in lines:
        if line == b"end":
            print(count, digest.hexdigest(), flush=True)
            sys.exit()
        count += 1
        digest.update(line + b"\\n")
"""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(finder, "LIST_S", 0.02)


def test_a_chip_that_may_be_anybodys_is_not_opened_until_a_person_adopts_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "imud")
    memory = tmp_path / "ports.json"

    async def check(desk: Desk) -> None:
        port, probe = desk.plug("ttyUSB0"), FakeProbe()
        await asyncio.sleep(0.3)  # it is listed, not opened
        assert not list(desk.finder)
        lines = [r.getMessage() for r in caplog.records]
        assert lines == [
            f"{port.path}: CH340 (1a86:7523), which may belong to another program: not "
            f"opened; if a probe is on it: imud ports adopt {port.path}"
        ]
        AdoptedPorts(memory).adopt(desk.devices[0], "adopted by a user")
        await desk.open_port(port)
        await desk.say_until_found(port, probe)
        # Released, it is closed although a probe is on it.
        assert AdoptedPorts(memory).release(desk.devices[0])
        await desk.until(lambda: not list(desk.finder))
        desk.unplug(port)

    at_desk(tmp_path, check, find=True)


def test_a_port_on_which_a_probe_was_heard_is_found_by_the_next_daemon(
    tmp_path: Path,
) -> None:
    probe = FakeProbe()

    async def named(desk: Desk) -> None:
        port = desk.plug("ttyUSB0")
        await desk.say_until_found(port, probe)
        await desk.until((tmp_path / "ports.json").exists)
        desk.unplug(port)

    async def found(desk: Desk) -> None:
        port = desk.plug("ttyUSB0")
        await desk.say_until_found(port, probe)
        desk.unplug(port)
        # Another of these chips, which have no serial numbers, in another socket.
        other = desk.plug("ttyUSB1", location="1-1.3")
        await asyncio.sleep(0.2)  # it is listed, not opened
        assert str(other.path) not in {p.name for p in desk.finder}
        desk.unplug(other)

    path = str(tmp_path / "ttyUSB0")
    at_desk(tmp_path, named, find=False, named=(path,))
    adopted = AdoptedPorts(tmp_path / "ports.json")
    adopted.refresh()
    (entry,) = adopted.known
    assert entry.by == f"probe {probe.name}"
    at_desk(tmp_path, found, find=True)


def test_a_board_with_our_name_is_opened_at_once(tmp_path: Path) -> None:
    async def check(desk: Desk) -> None:
        port = desk.plug("ttyACM0", product="imu-probe pico", vid=0x2E8A, pid=0xA)
        await desk.open_port(port)
        desk.unplug(port)

    at_desk(tmp_path, check, find=True)


@pytest.mark.parametrize("find", [True, "all"])
def test_another_program_on_a_port_gets_every_byte_and_its_board_is_not_reset(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    find: bool | str,
) -> None:
    """It asks for no lock. Opening the port would reset a board. Where imud searches
    all ports, it says so once, and searches this one when it is free."""
    caplog.set_level(logging.INFO, "imud")
    opened: list[str] = []
    plain = link._open
    monkeypatch.setattr(
        link, "_open", lambda name, baud: opened.append(name) or plain(name, baud)
    )
    monkeypatch.setattr(finder, "PAUSE_S", 0.05)

    async def check(desk: Desk) -> None:
        port = Port(tmp_path / "ttyUSB0")
        program = [sys.executable, "-c", OTHER, str(port.path)]
        with subprocess.Popen(
            program, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as other:
            assert other.stdin is not None
            assert other.stdout.readline() == b"open\n"
            desk.devices.append(Device(str(port.path)))
            sent, number = hashlib.sha256(), 0
            until_s = time.monotonic() + SECONDS
            while time.monotonic() < until_s:  # the other program reads
                line = b"%d\n" % number
                sent.update(line)
                port.write(line)
                number += 1
                await asyncio.sleep(0.002)
            port.write(b"end\n")
            told = await asyncio.to_thread(other.stdout.readline)
        assert told.decode().split() == [str(number), sent.hexdigest()]
        assert opened == []
        if find == "all":
            await desk.open_port(port)
        desk.unplug(port)

    at_desk(tmp_path, check, find=find)
    lines = [each.getMessage() for each in caplog.records if "in use by" in each.msg]
    assert len(lines) == (find == "all")
    for line in lines:
        assert re.search(
            r"ttyUSB0: in use by python\S* \(process \d+\); imud waits", line
        )


def test_a_damaged_memory_is_said_and_named_ports_go_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "ports.json").write_text("{")

    async def check(desk: Desk) -> None:
        port = desk.plug("ttyUSB0")
        await desk.say_until_found(port, FakeProbe())
        await asyncio.sleep(0.1)  # it is said meanwhile
        desk.unplug(port)

    at_desk(tmp_path, check, find=True, named=(str(tmp_path / "ttyUSB0"),))
    said = [r.getMessage() for r in caplog.records if "is damaged" in r.getMessage()]
    assert said
    with pytest.raises(FileError, match="adopt the ports again"):
        AdoptedPorts(tmp_path / "ports.json").refresh()


def test_a_place_that_can_not_be_written_loses_only_the_memory(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    adopted = AdoptedPorts(tmp_path / "file" / "ports.json")
    with pytest.raises(FileError, match="can't"):
        adopted.adopt(Device("/dev/ttyUSB9"), "probe x")


@pytest.mark.parametrize(
    ("serial", "is_so"),
    [
        ("A9007UX1", True),
        ("0001", False),
        ("00000000", False),
        ("123456", False),
        ("0123456789ABCDEF", False),
        (None, False),
    ],
)
def test_a_serial_number_that_all_have_tells_nobody_apart(
    serial: str | None, is_so: bool
) -> None:
    assert is_unique(serial) == is_so


def test_a_chip_with_a_number_of_its_own_is_known_in_any_socket(tmp_path: Path) -> None:
    adopted = AdoptedPorts(tmp_path / "ports.json")
    one = Device("/dev/ttyUSB8", serial_number="A9007UX1", location="1-1:1.0")
    moved = Device("/dev/ttyUSB9", serial_number="A9007UX1", location="3-2:1.0")
    second = Device("/dev/ttyUSB9", serial_number="A9007UX1", location="3-2:1.1")
    twin = Device("/dev/ttyUSB9", serial_number="0001", location="1-1:1.0")
    assert adopted.adopt(one, "probe x")
    assert not adopted.adopt(moved, "probe x")
    assert adopted.find(moved)
    assert not adopted.find(second)
    assert not adopted.find(twin)
    assert not adopted.release(twin)
    assert adopted.release(moved)
    assert not adopted.find(one)


def test_why_a_port_is_opened_or_not_is_said_of_each(tmp_path: Path) -> None:
    adopted = AdoptedPorts(tmp_path / "ports.json")
    mine = Device("/dev/ttyUSB0", location="1-1")
    adopted.adopt(mine, "adopted by a user")
    devices = [
        mine,
        Device("/dev/ttyUSB1", location="1-2"),
        Device("/dev/ttyUSB2", hwid="USB VID:PID=0403:6001", vid=0x403, pid=0x6001),
        Device("/dev/ttyS0", vid=None, pid=None, hwid="PNP0501"),
        Device("/dev/ttyUSB3", location="1-3"),
    ]
    settings = PortSettings(named=("/dev/ttyUSB3@115200",), ignore=("*0403:6001*",))
    found = {row.port: row for row in rows(devices, settings, adopted)}
    assert [found[d.device].standing for d in devices] == [
        *("adopted", "unknown", "ignored", "built in", "named")
    ]
    assert [found[d.device].is_opened for d in devices] == [
        *(True, False, False, False, True)
    ]
    assert "imud ports adopt /dev/ttyUSB1" in found["/dev/ttyUSB1"].why
    every = PortSettings(find="all")
    assert standing_of(devices[1], every, adopted) is Standing.ANY
    off = PortSettings(find=False, named=("/dev/x",))
    assert standing_of(mine, off, adopted) is Standing.OFF


def test_the_table_of_adapters_is_that_of_the_documents() -> None:
    assert table() in (ROOT / "docs" / "connect.md").read_text("utf-8"), table()
    ids = [adapter.usb_id for adapter in ADAPTERS]
    assert len(set(ids)) == len(ids)


def test_an_exact_id_comes_before_that_of_its_maker() -> None:
    assert kind_of(Device("x", vid=0x2341, pid=0x43)) == "Arduino (2341:0043)"
    assert adapter_of(Device("x", vid=0x1234, pid=1)) is None
    assert kind_of(Device("x", vid=0x1234, pid=1)) == "USB Serial (1234:0001)"
    assert kind_of(Device("/dev/rfcomm0", vid=None)) == "Bluetooth"
