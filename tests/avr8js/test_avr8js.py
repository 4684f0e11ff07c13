# SPDX-License-Identifier: MIT
"""The image that a user flashes, in an emulator that is not ours: Wokwi's avr8js.

The processor and its peripherals are avr8js's; the sensor on the bus is the model that
the other emulators use. `make check` installs avr8js and runs this.
"""

from __future__ import annotations

import itertools
import math
import shutil
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pytest

from avr8js.around import MODULES, Around, Chip, Seen
from bits.processors import has_sensor, replayed
from demanded import leave_out
from imud.wire.messages import Message, decode
from system.virtual import FIELDS_ALL, NANO, send, write_hand

POSES = 1000
POSES_AFTER_RESET = 100
PRESS_NS = 100_000_000

if shutil.which("node") is None or not (MODULES / "avr8js").is_dir():
    leave_out("node or avr8js is not there", is_whole_file=True)


# Data sheets: RM-MPU-9250A-00 rev 1.6, registers 27, 28, 37.
GYRO_CONFIG, ACCEL_CONFIG, SELF_TEST_AXES = 27, 28, 0xE0
I2C_SLV0_ADDR, READ_AK8963 = 37, 0x80 | 0x0C
SENSOR = 0x68
BURST = 22  # bytes
GRAVITY = 9.80665  # m/s2


@dataclass
class Heard:
    """Messages on the wire: POSES poses, and then those after a reset."""

    contents: list[bytes] = field(default_factory=list)
    reset_at: int = 0  # how many of them came before
    seen: Seen = field(default_factory=Seen)
    complaint: str | None = None
    bad: int = 0

    @cached_property
    def messages(self) -> list[Message]:
        decoded = [decode(content) for content in self.contents]
        assert all(isinstance(message, Message) for message in decoded)
        return [message for message in decoded if isinstance(message, Message)]

    def named(self, name: str) -> list[Message]:
        return [m for m in self.messages[: self.reset_at] if m.name == name]


class Host:
    """Asks for all that the probe can send, presses its button, resets it."""

    def __init__(self, heard: Heard, chip: Chip) -> None:
        self.heard = heard
        self.around = Around(chip, self.hear)
        self._poses = 0
        self._boots = 0

    def say(self, *commands: str) -> None:
        self.around.line.extend(bytes.fromhex("".join(commands)))

    def hear(self, content: bytes) -> None:
        heard = self.heard
        message = decode(content)
        assert isinstance(message, Message)
        if message.sequence == 0:
            heard.reset_at = len(heard.contents)
            self._boots += 1
            self._poses = 0
            self.say(FIELDS_ALL, send("rate", 1, NANO.rate_hz, token=6))
            self.around.press(PRESS_NS)  # has it stream
        heard.contents.append(content)
        if message.name != "pose":
            return
        self._poses += 1
        if self._boots == 1 and self._poses == POSES:
            self.say(send("reset"))
        self.around.is_over = self._boots == 2 and self._poses == POSES_AFTER_RESET


@pytest.fixture(scope="module")
def heard(image: Path, tmp_path_factory: pytest.TempPathFactory) -> Heard:
    found = Heard()
    hand = tmp_path_factory.mktemp("avr8js") / "hand"
    chip = Chip(write_hand(hand, 20))
    try:
        host = Host(found, chip)
        host.around.run(image.with_suffix(".hex"))
        found.seen = chip.seen
        found.complaint = chip.complaint
        found.bad = host.around.decoder.bad
    finally:
        chip.close()
    return found


def assert_equal_to_the_hosts(contents: list[bytes], count: int) -> None:
    poses = [content for content in contents if decode_name(content) == "pose"]
    assert len(poses) >= count
    assert any(has_sensor(c) for c in contents if decode_name(c) == "hello")
    reference = list(replayed(contents))
    first = next(
        (n for n, (a, b) in enumerate(zip(poses, reference, strict=True)) if a != b),
        None,
    )
    assert first is None, f"pose {first} of {len(poses)} differs"


def decode_name(content: bytes) -> str:
    message = decode(content)
    assert isinstance(message, Message)
    return message.name


def test_a_thousand_poses_are_those_of_the_hosts_c_bit_by_bit(heard: Heard) -> None:
    assert_equal_to_the_hosts(heard.contents[: heard.reset_at], POSES)


def test_after_a_reset_by_its_watchdog_the_poses_are_so_again(heard: Heard) -> None:
    hello = heard.messages[heard.reset_at]
    assert hello.name == "hello"
    assert hello.fields["reset_cause"] == ("software",)
    assert heard.messages[0].fields["reset_cause"] == ("power_on",)
    assert hello.fields["boot_count"] == 2  # so the EEPROM has kept its bytes
    assert_equal_to_the_hosts(heard.contents[heard.reset_at :], POSES_AFTER_RESET)


def test_set_up_self_test_and_bursts_go_over_its_bus(heard: Heard) -> None:
    assert heard.complaint is None
    assert SENSOR in heard.seen.addresses
    assert (I2C_SLV0_ADDR, READ_AK8963) in heard.seen.written
    for register in (GYRO_CONFIG, ACCEL_CONFIG):
        values = {value for at, value in heard.seen.written if at == register}
        assert any(value & SELF_TEST_AXES == SELF_TEST_AXES for value in values)
    samples = sum(message.name == "raw" for message in heard.messages)
    assert heard.seen.reads[BURST] >= samples > 2 * POSES


def test_its_samples_move_and_have_a_field(heard: Heard) -> None:
    raws = heard.named("raw")
    for name in ("acc", "gyr"):
        for axis in zip(*(raw.fields[name] for raw in raws), strict=True):
            assert max(axis) - min(axis) > 1000
    fields = [raw.fields["mag"] for raw in raws if raw.fields["mag"] is not None]
    assert len(fields) > len(raws) / 3
    assert len(set(fields)) > len(fields) / 2


def test_its_first_samples_lie_still_under_one_g(heard: Heard) -> None:
    (lsb,) = {m.fields["acc_lsb"] for m in heard.named("hello")} - {0.0}
    for raw in heard.named("raw")[:20]:
        assert math.hypot(*raw.fields["acc"]) * lsb == pytest.approx(GRAVITY, rel=0.1)


def test_nothing_is_lost_on_its_bus_and_its_wire(heard: Heard) -> None:
    assert heard.bad == 0
    before = heard.messages[: heard.reset_at]
    numbers = [message.sequence for message in before]
    assert numbers == [n % 65536 for n in range(len(numbers))]
    status = heard.named("status")[-1].fields
    for name in ("overruns", "bus_faults", "messages_dropped", "receive_lost"):
        assert status[name] == 0
    assert status["commands_received"] == 2
    times = [raw.time_us for raw in heard.named("raw")]
    gaps = [after - before for before, after in itertools.pairwise(times)]
    assert max(gaps) < 1.1 * 1e6 / NANO.rate_hz


def test_its_button_and_its_supply_are_read(heard: Heard) -> None:
    events = [event.fields["event"] for event in heard.named("event")]
    assert events.count("button_pressed") == events.count("button_released") == 1
    assert 4900 < heard.named("status")[-1].fields["supply"] < 5100  # mV
