# SPDX-License-Identifier: MIT
"""A log replayed: on a pty, into a daemon, over Zenoh."""

from __future__ import annotations

import os
import termios
import time
from pathlib import Path

import msgspec
import pytest

from fakes import DaemonProcess, FakeProbe, free_endpoint
from imud import cli
from imud.cli import recordings
from imud.recordings import replay
from imud.wire import schema
from imud.wire.frame import FrameDecoder
from log_files import frames, records, replaying, write


def test_pace_follows_the_times_of_the_log() -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(round(seconds, 6))
        now[0] += seconds

    pace = replay.Pacer(4.0, lambda: now[0], sleep)
    for t_ns in (0, 10**9, 1_500_000_000, 1_400_000_000, 3 * 10**9):
        pace.wait(t_ns)
    assert slept == [0.25, 0.125, 0.375]
    slept.clear()
    free = replay.Pacer(None, lambda: now[0], sleep)
    free.wait(0)
    free.wait(10**12)
    assert slept == []
    assert recordings.speed("0") is recordings.speed("max") is None


def test_a_reader_that_flushes_late_and_reads_slowly_gets_all(tmp_path: Path) -> None:
    """As imud does on a busy machine: what it flushes is not to be in it yet."""
    put = records(200)
    path = write(tmp_path, put)
    link = tmp_path / "probe"
    with replaying(path, link):
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        time.sleep(1.0)
        termios.tcflush(port, termios.TCIFLUSH)
        attributes = termios.tcgetattr(port)
        attributes[2] &= ~termios.HUPCL
        termios.tcsetattr(port, termios.TCSANOW, attributes)
        found = b""
        while found.count(0) < len(put):
            found += os.read(port, 500)
            time.sleep(0.005)
        os.close(port)
    assert len(FrameDecoder().feed(found)) == len(put)


def test_a_log_replayed_into_a_daemon_is_heard_as_a_probe(tmp_path: Path) -> None:
    probe = FakeProbe()
    put = records(200, probe)
    hello = probe.content("hello")
    last = put[-1]
    put.append(msgspec.structs.replace(last, topic="hello", payload=b"", content=hello))
    path = write(tmp_path / "in", put)
    link = tmp_path / "probe"
    with DaemonProcess(link, directory=tmp_path) as daemon:
        with replaying(path, link):
            daemon.expect("probe 00112233445566aa found")
        daemon.stop()
        assert frames(daemon.log) == [record.content for record in put]


def test_of_several_probes_one_is_chosen_for_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3, name="left"), records(3, name="right"))
    assert cli.main(["replay", str(path), "--link", str(tmp_path / "x")]) == 1
    assert "choose one with --probe" in capsys.readouterr().err
    assert cli.main(["replay", str(path), "--probe", "up"]) == 1
    assert "no probe up; available: left, right" in capsys.readouterr().err


def test_a_log_of_another_schema_is_not_given_out_as_of_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The seed of a frame's CRC would say that it is."""
    path = write(tmp_path, records(3))
    monkeypatch.setattr(schema, "FINGERPRINT", schema.FINGERPRINT ^ 1)
    assert cli.main(["replay", str(path)]) == 1
    assert "has another schema than this imud" in capsys.readouterr().err


def test_an_endpoint_without_a_network_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, records(3))
    assert cli.main(["replay", str(path), "--connect", free_endpoint()]) == 1
    assert capsys.readouterr().err.startswith("imud: no imud at")
