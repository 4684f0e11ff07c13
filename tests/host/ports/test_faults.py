# SPDX-License-Identifier: MIT
"""Faults of a port: one line each, and the daemon continues."""

from __future__ import annotations

import fcntl
import json
import os
import queue
from pathlib import Path
from threading import Thread

import pytest

from chain import Chain
from fakes import PATIENCE_S, DaemonProcess, FakeProbe, Port
from imud import _core
from imud.client import Client
from imud.errors import CommandRefused
from imud.wire import schema


def test_an_absent_port_is_told_once_and_taken_up_when_it_comes(
    tmp_path: Path,
) -> None:
    with DaemonProcess(tmp_path / "port", directory=tmp_path, log=False) as process:
        process.expect("port does not exist; imud opens it when it appears")
        probe, port = FakeProbe(), Port(tmp_path / "port")
        process.expect(": open$")
        port.write(probe.say("hello"))
        process.expect("found on")
        process.stop()
        port.vanish()
        assert sum("does not exist" in line for line in process.lines) == 1


def test_a_port_that_vanishes_is_told_once_and_counted_over(chain: Chain) -> None:
    chain.port.write(chain.probe.poses(5) + chain.probe.say("event"))
    chain.daemon.expect("stream started")
    chain.port.vanish()
    chain.daemon.expect("port disappeared; imud opens it when it returns")
    chain.probe.poses(4)
    chain.port = Port(chain.port.path)
    chain.daemon.expect(": open$")
    chain.port.write(chain.probe.say("hello"))
    chain.daemon.expect("found on")
    status = chain.status_when(lambda s: s["port"] is not None)
    assert status["ledger"]["lost"] == 4
    chain.daemon.stop()
    lines = [line for line in chain.daemon.lines if "port" in line]
    assert sum("disappeared" in line for line in lines) == 1
    assert sum("does not exist" in line for line in lines) == 0


def test_a_busy_port_is_told_once_and_taken_up_when_it_is_free(tmp_path: Path) -> None:
    port = Port(tmp_path / "port")
    holder = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("port is in use by another program")
        fcntl.flock(holder, fcntl.LOCK_UN)
        process.expect(": open$")
        process.stop()
        assert sum("in use by" in line for line in process.lines) == 1
    os.close(holder)
    port.vanish()


def test_a_file_that_is_no_port_is_told_once(tmp_path: Path) -> None:
    file = tmp_path / "port"
    file.touch()
    with DaemonProcess(file, directory=tmp_path, log=False) as process:
        process.expect("port can't be opened; check that it is a serial port")
        process.stop()
        assert sum("serial port" in line for line in process.lines) == 1


def test_a_stream_of_noise_is_told_once_and_ends_nothing(tmp_path: Path) -> None:
    port, probe = Port(tmp_path / "port"), FakeProbe()
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("listens on")
        port.wait_open()
        noise = bytes(range(1, 256)) * 2
        port.write(noise)
        process.expect(
            "510 bytes without a valid message; check that it is a probe at 500000"
        )
        port.write(noise + b"\0" + probe.say("hello"))
        process.expect("found on")
        process.stop()
        assert sum("without a valid message" in line for line in process.lines) == 1
    port.vanish()


def test_an_older_probe_is_read_and_commanded_and_to_be_updated(
    tmp_path: Path,
) -> None:
    port = Port(tmp_path / "port")
    probe = FakeProbe(schema_fingerprint=0xFB1DF6ED)
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.find(port, probe)
        line = process.expect("has older firmware")
        assert f"update it with imud flash {port.path}" in line
        with Client(process.endpoint) as client:
            client.wait_for(seconds=PATIENCE_S)
            server = Thread(target=port.serve, args=(probe, 1))
            server.start()
            client.command(probe.name, "start")
            server.join()
        process.stop()
    assert [command["command"] for command in probe.commands] == ["start"]
    port.vanish()


def test_a_probe_of_another_schema_is_told_once_and_listed(tmp_path: Path) -> None:
    port = Port(tmp_path / "port")
    probe = FakeProbe(
        schema_fingerprint=schema.FINGERPRINT ^ 0x1234, firmware="0.0.9+old"
    )
    with DaemonProcess(port.path, directory=tmp_path, log=False) as process:
        process.expect("listens on")
        port.wait_open()
        for _ in range(20):
            content = probe.content("pose")
            port.write(_core.encode_frame(schema.SEED ^ 0x1234, content))
            port.write(probe.say("hello"))
        line = process.expect("has schema")
        assert f"{schema.FINGERPRINT ^ 0x1234:#010x} (firmware 0.0.9+old)" in line
        assert "update one of them" in line
        with Client(process.endpoint) as client:
            heard: queue.Queue[bytes] = queue.Queue()
            client.subscribe("status", None, lambda _, payload: heard.put(payload))
            status = json.loads(heard.get())
            assert status["state"] == "other schema"
            assert status["hello"]["firmware"] == "0.0.9+old"
            assert status["link"]["corrupt"] == 0
            assert status["link"]["foreign"] + status["link"]["partial"] == 20
            with pytest.raises(CommandRefused, match="has another schema"):
                client.command(probe.name, "start")
        process.stop()
        assert sum("has schema" in line for line in process.lines) == 1
        assert not any("corrupt" in line for line in process.lines)
    port.vanish()
