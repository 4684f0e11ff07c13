# SPDX-License-Identifier: MIT
"""The Pico's images in rp2040js: the same bits as on the host, and what is the Pico's
own. The tests that all boards share run with it in `make test-long`.
"""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from bits.processors import replayed
from demanded import leave_out
from imud.virtual.boards import PICO as VIRTUAL
from length import choose
from programs import ran
from system.virtual import (
    PICO,
    Run,
    Stub,
    assert_nothing_is_lost,
    damaged,
    run,
    send,
    write_hand,
)

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR = ROOT / VIRTUAL.simulator
IMAGE = ROOT / VIRTUAL.image
MICROPYTHON = IMAGE.with_name("pico-micropython.elf")
CLICK = ("--press", "200000:300000")  # before the sensor is ready
UDF = 0xDE00  # for ever undefined in Thumb

if not (SIMULATOR.exists() and IMAGE.exists()):
    leave_out("the virtual Pico is not there", is_whole_file=True)


@pytest.fixture
def pico(tmp_path: Path) -> Stub:
    """The image in C."""
    return Stub(PICO, SIMULATOR, IMAGE, tmp_path)


def with_micropython(pico: Stub) -> Stub:
    """The same board with MicroPython."""
    if not MICROPYTHON.exists():
        leave_out("MicroPython for the Pico is not there")
    return dataclasses.replace(pico, image=MICROPYTHON)


def followed(stub: Stub, seconds: float, *options: object) -> Run:
    """A hand moves it, while its origin and its filter change."""
    words: list[object] = ["--motion", write_hand(stub.folder / "hand", seconds)]
    words += [*CLICK, *stub.raw_too, *options]
    changes = (("tare", 0, 3.5), ("tare", 1, 4.0), ("restart", 0, 5.0), ("tare", 2, 6))
    for token, (command, argument, at_s) in enumerate(changes, start=8):
        order = send(command, argument, token=token)
        words += ["--send", f"{round(at_s * 1e6)}:{order}"]
    return run(stub, seconds, *words)


def assert_the_poses_are_the_hosts(done: Run, at_least: int) -> None:
    both = zip(done.contents, done.messages, strict=True)
    poses = [content for content, message in both if message.name == "pose"]
    assert len(poses) > at_least
    assert poses == list(replayed(done.contents))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("wire", ["usb", "uart"])
def test_its_poses_are_in_every_bit_those_of_the_host(pico: Stub, wire: str) -> None:
    seconds = choose(everyday=7, long=600)
    done = followed(pico, seconds, "--wire", wire)
    assert_the_poses_are_the_hosts(done, 100 * (seconds - 2))
    assert_nothing_is_lost(done)
    assert done.summary["cycles_worst"] < 0.1 * PICO.clock_hz / PICO.rate_hz


def test_without_a_data_ready_wire_it_asks_and_its_times_are_those_of_the_edges(
    pico: Stub,
) -> None:
    seconds = choose(everyday=4, long=60)
    wired = followed(pico, seconds)
    done = followed(pico, seconds, "--ready", "none")
    assert_the_poses_are_the_hosts(done, 100 * (seconds - 2))
    assert ("data_ready_polled", "no_data_ready") in done.events
    # The sensor's clock is the same in both: its edges are 5 ms apart.
    phase = np.median([raw.time_us % 5000 for raw in wired.named("raw")])
    times = np.array([raw.time_us for raw in done.named("raw")])
    errors = (times - phase + 2500) % 5000 - 2500
    assert np.percentile(np.abs(errors), 99) < 100
    assert np.all(np.diff(times) < 5300)
    # The first edge, of which nobody knows when it came, is counted.
    assert done.last_status["overruns"] == 1
    assert done.summary["late"] == 0
    assert done.account["lost"] == 0


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("ready", ["wire", "none"])
def test_micropythons_poses_are_those_of_the_host(pico: Stub, ready: str) -> None:
    done = followed(with_micropython(pico), 60, "--wire", "usb", "--ready", ready)
    assert_the_poses_are_the_hosts(done, 5700)
    hello = done.named("hello")[-1].fields
    assert hello["board"] == "micropython"
    # A board keeps its id when it changes its firmware.
    (native, *_) = run(pico, 1).named("hello")
    assert hello["probe_id"] == native.fields["probe_id"]


def symbol(image: Path, name: str) -> int:
    """Where a function of an image begins."""
    shown = ran("arm-none-eabi-nm", image, check=True)
    found = [line.split() for line in shown.stdout.splitlines()]
    (address,) = (line[0] for line in found if line[-1] == name)
    return int(address, 16)


def test_it_tells_who_it_is_and_what_feeds_it(pico: Stub) -> None:
    done = run(pico, 2.5)
    hello = done.named("hello")[-1].fields
    assert (hello["board"], hello["sensor"]) == ("pico", "mpu9250")
    assert hello["reset_cause"] == ("power_on",)
    assert 4900 < done.last_status["supply"] < 5100
    assert 1000 < done.last_status["stack_free"] < PICO.stack
    other = run(pico, 1, "--seed", 7)
    assert other.named("hello")[-1].fields["probe_id"] != hello["probe_id"]


def rewired(pico: Stub, before: str, after: str) -> Stub:
    """The same board with a line of its emulator's wiring replaced."""
    folder = pico.folder / "rewired"
    shutil.copytree(SIMULATOR.parent, folder, symlinks=True)
    machine = folder / "machine.mjs"
    first, last = machine.read_text().split(before)
    machine.write_text(first + after + last)
    return dataclasses.replace(pico, simulator=folder / SIMULATOR.name)


@pytest.mark.parametrize(
    "has_python", [False, pytest.param(True, marks=pytest.mark.nightly)]
)
def test_on_a_pico_w_the_supply_is_unknown(pico: Stub, *, has_python: bool) -> None:
    # Between VSYS and its pin is a switch, which GP25 closes.
    level = "mcu.adc.channelValues[3] = state === 1 ? VSYS_COUNTS : 38;"
    switch = f"mcu.gpio[25].addListener((state) => {{{level}}});"
    line = "mcu.adc.channelValues[3] = VSYS_COUNTS;"
    stub = with_micropython(pico) if has_python else pico
    rewritten = rewired(stub, line, "mcu.adc.channelValues[3] = 38;" + switch)
    done = run(rewritten, 6 if has_python else 2.5, "--wire", "usb")
    assert done.last_status["supply"] is None


# Of rp2040js's controller: what a host does that reads late, or not for a while.
USB_HOST = """const cdc = new USBCDC(mcu.usbCtrl);
    const usb = mcu.usbCtrl;
    const DEVICE_SUSPENDED = 1 << 4, RESUMED = 1 << 11, SIE_STATUS = 0x50;
    const give = usb.DPRAMUpdated.bind(usb), write = usb.writeUint32.bind(usb);
    const later = (ns, work) => this.clock.createAlarm(work).schedule(ns);
    const tell = (bit) => { usb.sieStatus |= bit; usb.sieStatusUpdated(); };
    usb.writeUint32 = (offset, value) => {
      const cleared = offset === SIE_STATUS ? usb.rawWriteValue : 0;
      usb.sieStatus &= ~(cleared & DEVICE_SUSPENDED);
      write(offset, value);
    };
    usb.DPRAMUpdated = (offset, value) => {
      const isIn = offset === 0x80 + 8 * cdc.inEndpoint && cdc.initialized;
      const wait = isIn ? FREE_NS(this.now()) - this.now() : 0;
      if (wait > 0) later(wait, () => give(offset, value));
      else give(offset, value);
    };
"""


LATE = "(t) => t + (t > 1.5e9 && t < 2e9 ? 1e6 : 0)"
NOT = "(t) => (t > 1.5e9 && t < 3e9 ? 3e9 : t)"
SUSPENDED = """later(1.5e9, () => tell(DEVICE_SUSPENDED));
    later(3e9 - 1e5, () => tell(RESUMED));"""


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("free_ns", "signals", "gap_ms"),
    [(LATE, "", 5), (NOT, "", 925), (NOT, SUSPENDED, 1505)],
    ids=["late", "not", "suspended"],
)
def test_a_host_that_does_not_read_loses_what_does_not_fit_until_it_does(
    pico: Stub, free_ns: str, signals: str, gap_ms: int
) -> None:
    host = USB_HOST.replace("FREE_NS", f"({free_ns})") + signals
    wired = rewired(pico, "const cdc = new USBCDC(mcu.usbCtrl);", host)
    done = run(wired, 4.5, *CLICK, *pico.raw_too, "--wire", "usb")
    assert done.summary["late"] == done.last_status["overruns"] == 0
    times = [raw.time_us for raw in done.named("raw")]
    assert max(np.diff(times)) == pytest.approx(1000 * gap_ms, abs=50_000)
    assert times[-1] > 4_450_000
    # While it is suspended they go to UART0, as if the cable was pulled.
    dropped = 0 if signals else done.account["lost"]
    assert done.last_status["messages_dropped"] == dropped
    assert (done.account["lost"] > 0) == (gap_ms > 5)
    assert not done.account["skewed"]


def test_the_fix_of_usb_beside_others_on_a_hub_is_in_the_image(pico: Stub) -> None:
    assert symbol(pico.image, "hw_enumeration_fix_force_ls_j_done")


def test_settings_outlive_power_and_an_update(pico: Stub) -> None:
    flash = pico.folder / "flash"
    order = send("rate", 0, 37)
    for boot in range(1, 4):
        options = ("--send", f"700000:{order}") if boot == 1 else ()
        done = run(pico, 2, "--eeprom", flash, *options)
        hello = done.named("hello")[-1].fields
        assert (hello["boot_count"], hello["pose_rate"]) == (boot, 37)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("fault", "cause"), [("reset", "external"), ("brown_out", "power_on")]
)
def test_a_reset_is_told_in_the_next_hello(pico: Stub, fault: str, cause: str) -> None:
    done = run(pico, 3, faults=[{"kind": fault, "at_us": 1_500_000}])
    assert done.summary["resets"] == 1
    assert done.named("hello")[-1].fields["reset_cause"] == (cause,)


def test_a_bad_instruction_is_told_with_its_address(pico: Stub) -> None:
    # The first of flash_init(), which a start with a blank flash reaches.
    address = symbol(pico.image, "board_supply_mv")
    done = run(damaged(pico, address, UDF), 3)
    hello = done.named("hello")[-1].fields
    assert hello["reset_cause"] == ("hard_fault",)
    assert hello["reset_address"] == address
