# SPDX-License-Identifier: MIT
"""Frames in files: numbered, told where they can't be written, and not held up by a
wire that nobody reads."""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "firmware/micropython/probe"
STARTED, FAULT, FULL = 19, 17, 18  # events


class Clock:
    ms = 0


class File:
    """As MicroPython's: write() has a place and a length."""

    def __init__(self, name: str, room: int = 10_000) -> None:
        self.file = Path(name).open("wb")  # noqa: SIM115 - closed below
        self.room = room

    def write(self, data: bytes, at: int, length: int) -> int:
        length = min(length, self.room)
        self.room -= length
        return self.file.write(data[at : at + length])

    def flush(self) -> None:
        self.file.flush()

    def close(self) -> None:
        self.file.close()


class Probe:
    def __init__(self, waiting: bytes = b"") -> None:
        self.told: list[tuple[int, int]] = []
        self.waiting = waiting

    def tell(self, event: int, _cause: int, detail: int) -> None:
        self.told.append((event, detail))

    def take(self, buffer: bytearray) -> int:
        taken, self.waiting = self.waiting[: len(buffer)], self.waiting[len(buffer) :]
        buffer[: len(taken)] = taken
        return len(taken)


class Wire:
    """Takes some bytes at a time, or none."""

    def __init__(self, most: int) -> None:
        self.most = most
        self.got = b""

    def write(self, data: bytes, at: int, length: int) -> int | None:
        length = min(length, self.most)
        self.got += bytes(data[at : at + length])
        return length or None


def loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, PACKAGE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setitem(sys.modules, "micropython", SimpleNamespace(const=int))
    monkeypatch.setattr(time, "ticks_ms", lambda: Clock.ms, raising=False)
    monkeypatch.setattr(time, "ticks_diff", lambda a, b: a - b, raising=False)
    found = loaded("log")
    found.Tee = loaded("relay").Tee  # type: ignore[attr-defined]
    monkeypatch.setattr(found, "open", lambda name, _: File(name), raising=False)
    return found


def test_each_start_has_a_file_of_its_own(module: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "imu-0007.bin").write_bytes(b"older")
    (tmp_path / "imu-notes.bin").write_bytes(b"not ours")
    probe = Probe()
    for text in (b"one", b"two"):
        log = module.FileLog(str(tmp_path))
        log.open(probe)
        log.write(b"--" + text, 2, 3)
        log.close()
    assert (tmp_path / "imu-0008.bin").read_bytes() == b"one"
    assert (tmp_path / "imu-0009.bin").read_bytes() == b"two"
    assert probe.told == [(STARTED, 8), (STARTED, 9)]


def test_no_card_and_a_full_one_are_told_once(
    module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    probe = Probe()
    log = module.FileLog(str(tmp_path / "absent"))
    log.open(probe)
    for _ in range(3):
        log.write(b"data", 0, 4)
        log.step(probe)
    assert probe.told == [(FAULT, 0)]
    monkeypatch.setattr(module, "open", lambda name, _: File(name, 3), raising=False)
    log = module.FileLog(str(tmp_path))
    log.open(probe)
    for _ in range(3):
        log.write(b"data", 0, 4)
        log.step(probe)
    assert probe.told[1:] == [(STARTED, 1), (FULL, 0)]


@pytest.mark.parametrize("most", [1, 7, 1000])
def test_log_and_wire_get_the_same_bytes(
    module: ModuleType, tmp_path: Path, most: int
) -> None:
    data = bytes(range(256)) * 5
    probe, wire = Probe(data), Wire(most)
    log = module.FileLog(str(tmp_path))
    log.open(probe)
    sent_all(module.Tee(wire, log), probe)
    log.close()
    assert wire.got == data
    assert (tmp_path / "imu-0001.bin").read_bytes() == data


def test_a_wire_that_nobody_reads_does_not_hold_up_the_log(
    module: ModuleType, tmp_path: Path
) -> None:
    data = bytes(range(256)) * 5
    probe, wire = Probe(data), Wire(0)
    log = module.FileLog(str(tmp_path))
    log.open(probe)
    tee = module.Tee(wire, log)
    send = tee.sender(probe)
    assert send(tee) > 0
    Clock.ms += 499
    assert send(tee) > 0
    Clock.ms += 1
    sent_all(tee, probe)
    log.close()
    assert (tmp_path / "imu-0001.bin").read_bytes() == data


def sent_all(tee: Any, probe: Probe) -> None:
    send = tee.sender(probe)
    for _ in range(5000):
        if not send(tee) and not probe.waiting:
            return
    pytest.fail("it does not end")
