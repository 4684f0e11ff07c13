# SPDX-License-Identifier: MIT
"""The package in MicroPython's own unix port, as PyPI has it: frames, commands, and
files on its own file systems with the power cut at every write."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from imud.journal.faults import fault_words
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode
from micropython_frames import PACKAGE, PROGRAMS, assert_frames_are_those_of_c
from programs import ran

PATH = f"{PROGRAMS / 'fake'}:{PACKAGE.parent}"


def run(
    stock: Path, *words: object, path: str = PATH, **options: Path
) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"MICROPYPATH": path}
    return ran(stock, *words, env=environment, **options)


def test_its_frames_are_those_of_the_c(stock: Path, tmp_path: Path) -> None:
    assert_frames_are_those_of_c([stock, "-X", "heapsize=16m"], 1000, tmp_path)


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_without_the_module_a_command_is_obeyed_and_answered_once(
    stock: Path, size: int
) -> None:
    wanted = [("start", 1), ("start", 1), ("rate", 2), ("tare", 3), ("stop", 4)]
    frames = [b"\0" + encode_frame(b"noise"), b"\xff" * 100 + b"\0"]
    for number, (name, token) in enumerate(wanted):
        fields = {"command": name, "token": token, "arguments": (1, 50)}
        frames.append(encode_frame(encode("command", fields, number, 0)))
    done = run(
        stock, PROGRAMS / "obey.py", str(size), *(frame.hex() for frame in frames)
    )
    assert done.returncode == 0, done.stderr
    sent = [decode(each) for each in FrameDecoder().feed(bytes.fromhex(done.stdout))]
    messages = [m.fields for m in sent if isinstance(m, Message)]
    replies = [m for m in messages if "result" in m]
    assert [m["replied_token"] for m in replies] == [token for _, token in wanted]
    results = [m["result"] for m in replies]
    assert results == ["ok", "ok", "ok", "unknown_command", "ok"]
    events = [m["event"] for m in messages if "event" in m]
    assert events == ["stream_started", "stream_stopped"]


@pytest.mark.parametrize(("system", "writes"), [("littlefs", 12), ("fat", 8)])
def test_a_power_cut_at_any_write_leaves_whole_settings(
    stock: Path, system: str, writes: int
) -> None:
    done = run(stock, PROGRAMS / "files.py", PACKAGE, system)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == writes


def ended(stock: Path, *places: Path) -> tuple[str, list[Message]]:
    """What ends.py did, and the events that were sent."""
    path = ":".join(map(str, (*places, PROGRAMS / "fake", PACKAGE.parent)))
    done = run(stock, PROGRAMS / "ends.py", path=path)
    assert done.returncode == 0, done.stdout + done.stderr
    did, frames = done.stdout.splitlines()
    sent = map(decode, FrameDecoder().feed(bytes.fromhex(frames)))
    return did, [m for m in sent if isinstance(m, Message) and m.name == "event"]


def test_ctrl_c_has_no_meaning_from_the_import_on_and_gets_it_back(stock: Path) -> None:
    did, events = ended(stock)
    begun = [-1, -1, "facts", "pin on", "log open"]
    after = ["interrupted", "log closed", 3, "pin off", "raised"]
    assert did == str(begun + after)
    assert not events


def test_a_module_of_another_processor_is_told_and_raw_samples_are_sent(
    stock: Path, tmp_path: Path
) -> None:
    # Of version 6.3, for an Xtensa with windows.
    (tmp_path / "imuprobe.mpy").write_bytes(bytes((*b"M", 6, 10 << 2 | 3, 31, 0)))
    _, (event,) = ended(stock, tmp_path)
    assert (event.fields["event"], event.fields["cause"]) == ("hook_failed", "rejected")
    assert "another processor" in fault_words("hook_failed", "rejected", 0)


def test_a_sensor_of_the_module_alone_is_refused_without_it(stock: Path) -> None:
    program = "import probe; probe.LSM6DSOX(None).attach_plain(None, None)"
    done = run(stock, "-c", program)
    assert done.returncode == 1
    refused = "ValueError: an LSM6DSOX needs the C module: docs/micropython.md"
    assert (done.stdout + done.stderr).strip().endswith(refused)


def test_a_sensor_is_found_by_its_name(stock: Path) -> None:
    program = """
from probe.sensors import detected
class I2C:
    def __init__(self, *names):
        self.names = {(device, at): bytes((value,)) for device, at, value in names}
    def readfrom_mem(self, device, at, _):
        if (device, at) not in self.names:
            raise OSError(5)
        return self.names[device, at]
clock = (0x68, 0x75, 0x12)
for names in [(0x68, 0x75, 0x71)], [clock, (0x6A, 0x0F, 0x6C)], [(0x6B, 0x0F, 0xD4)]:
    print(type(detected(I2C(*names))).__name__)
"""
    done = run(stock, "-c", program)
    assert done.stdout.split() == ["MPU9250", "LSM6DSOX", "LSM9DS0"], done


def test_a_network_that_was_lost_is_joined_again(stock: Path, tmp_path: Path) -> None:
    program = """
import network
from probe import wifi
class Station:
    is_up = False
    def __init__(self, _): pass
    def active(self, _): pass
    def isconnected(self): return self.is_up
    def connect(self, *words):
        tries.append(now)
        if len(tries) == 2:
            raise OSError
network.WLAN = Station
wifi.ticks_ms = lambda: now
tries, now = [], 0
home = wifi.Network("home", "secret", "127.0.0.1", 9)
for now in range(0, 60000, 1000):
    Station.is_up = 20000 <= now < 30000
    home.step()
print(tries)
"""
    (tmp_path / "probe.key").write_text(64 * "0")
    done = run(stock, "-c", program, cwd=tmp_path)
    assert done.stdout.strip() == "[0, 15000, 44000, 59000]", done
