# SPDX-License-Identifier: MIT
"""Ports that other programs have open."""

from __future__ import annotations

import asyncio
import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

from fakes import Port
from imud.ports import finder
from ports_desk import Desk, Device, at_desk


def test_a_port_that_another_program_has_open_is_left_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It loses no byte, is told of once, and the port is searched once it is free."""
    caplog.set_level(logging.INFO, "imud")
    monkeypatch.setattr(finder, "PAUSE_S", 0.05)
    monkeypatch.setattr(finder, "LIST_S", 0.02)
    reader = "import sys\nwith open(sys.argv[1], 'rb', buffering=0) as port:\n"
    reader += "    print('open', flush=True)\n"
    reader += "    while b'!' not in (data := port.read(4096)): print(len(data))\n"
    reader += "    print(len(data))\n"

    async def check(desk: Desk) -> None:
        pty = Port(tmp_path / "ttyUSB0")
        with subprocess.Popen(
            [sys.executable, "-c", reader, str(pty.path)],
            stdout=subprocess.PIPE,
            text=True,
        ) as other:
            assert other.stdout is not None
            assert other.stdout.readline() == "open\n"
            desk.devices.append(Device(str(pty.path)))
            sent = 0
            for _ in range(50):
                pty.write(b"x" * 100)
                sent += 100
                await asyncio.sleep(0.02)
                assert not list(desk.finder)
            pty.write(b"!")
            got = sum(map(int, other.stdout.read().split()))
        assert got == sent + 1
        await desk.open_port(pty)
        desk.unplug(pty)

    at_desk(tmp_path, check)
    lines = [each.getMessage() for each in caplog.records if "in use by" in each.msg]
    assert len(lines) == 1
    assert re.search(
        r"ttyUSB0: in use by python\S* \(process \d+\); imud waits", lines[0]
    )
