# SPDX-License-Identifier: MIT
"""The virtual Nano's pseudo terminal, which hosts open, flood and close."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from length import choose
from nano_desk import BOOT, EEPROM, FLOOD, NANO, image

FLOODS = choose(everyday=1, long=2)


@pytest.fixture(scope="module")
def desk() -> Path:
    return image()


@contextlib.contextmanager
def on_the_wire(
    desk: Path, tmp_path: Path, *more: str
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    link = tmp_path / "wire"
    summary = tmp_path / "summary.json"
    process = subprocess.Popen(
        [NANO, "--image", desk, "--pty", link, "--summary", summary, *more],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr.readline() == f"ready {link}\n"
        yield process, link
    finally:
        process.kill()
        process.communicate()


def open_wire(link: Path) -> int:
    wire = os.open(link, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(wire)
    return wire


def read_past(wire: int, mark: bytes) -> None:
    """Read up to a byte; what the firmware says at its start may come before it."""
    while (byte := read(wire, 1)) != mark:
        assert byte, "nothing more comes"


def read(wire: int, length: int) -> bytes:
    data = b""
    while len(data) < length and select.select([wire], [], [], 20)[0]:
        data += os.read(wire, length - len(data))
    return data


def stop(process: subprocess.Popen[str], tmp_path: Path) -> Any:
    process.send_signal(signal.SIGTERM)
    assert process.wait() == 0
    return json.loads((tmp_path / "summary.json").read_text())


@pytest.mark.parametrize("pace", [[], ["--fast"]])
def test_bytes_go_both_ways_over_the_pty(
    desk: Path, tmp_path: Path, pace: list[str]
) -> None:
    with on_the_wire(desk, tmp_path, *pace) as (process, link):
        wire = open_wire(link)
        os.write(wire, b"?")
        read_past(wire, b"?")
        for start in range(0, 3000, 300):
            sent = bytes((start + i) % 224 for i in range(300))
            assert os.write(wire, sent) == 300
            assert read(wire, 300) == sent
        os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["uart_overruns"] == 0
    assert summary["uart_dropped"] == 0
    assert not link.is_symlink()


def test_a_flood_faster_than_time_loses_nothing(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path, "--fast") as (process, link):
        wire = open_wire(link)
        os.write(wire, b"?")
        read_past(wire, b"?")
        os.write(wire, bytes([FLOOD]))
        data = read(wire, 60_000)
        os.close(wire)
        summary = stop(process, tmp_path)
    assert data == bytes(i % 251 + 1 for i in range(60_000))
    assert summary["uart_dropped"] == 0


@pytest.mark.long
def test_what_nobody_hears_is_gone_and_counted(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path, "--fast") as (process, link):
        for _ in range(FLOODS):
            wire = open_wire(link)
            os.write(wire, b"?")
            read_past(wire, b"?")
            os.write(wire, bytes([FLOOD]))
            assert read(wire, 1)  # the flood has begun
            os.close(wire)
            wire = open_wire(link)
            read_past(wire, b"\x00")  # the flood is over
            os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["uart_unheard"] > 0
    assert summary["bytes"] == len(BOOT) + FLOODS * (1 + 60_001)


def test_a_writer_that_closes_at_once_is_heard(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path) as (process, link):
        link.write_bytes(bytes([EEPROM]) + b"!")
        wire = open_wire(link)
        read_past(wire, b"!")  # echoed when the EEPROM is written, after 14 ms
        os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["eeprom_writes"] == 4


def test_a_stale_link_is_replaced_and_a_file_of_others_is_kept(
    desk: Path, tmp_path: Path
) -> None:
    link = tmp_path / "wire"
    link.symlink_to("/nowhere")
    with on_the_wire(desk, tmp_path) as (process, _):
        assert str(link.readlink()).startswith("/dev/pts/")
        link.unlink()
        link.write_text("another program's")
        stop(process, tmp_path)
    assert link.read_text() == "another program's"
