# SPDX-License-Identifier: MIT
"""The states of a probe: calibration, faults, the button, the light, its settings."""

from __future__ import annotations

from itertools import pairwise

import pytest

from core.desk import lib
from core.probe_bench import OK, REST, Bench, Memory, streaming
from protocol import wire

# States, calibration, faults.


def test_a_probe_calibrates_idles_and_streams():
    bench = Bench()
    assert bench.state == lib.STATE_CALIBRATING
    bench.find_sensor().run(2.5)
    assert bench.state == lib.STATE_CALIBRATING
    bench.run(0.06)
    assert bench.state == lib.STATE_IDLE
    assert bench.events()[-1] == (lib.EVENT_CALIBRATION_DONE, lib.CAUSE_NONE, 512)
    assert not bench.of("pose")
    bench.command(lib.COMMAND_START)
    assert bench.state == lib.STATE_STREAMING
    bench.run(1)
    assert bench.of("status")[-1].fields["state"] == lib.STATE_STREAMING
    bench.command(lib.COMMAND_STOP)
    assert bench.state == lib.STATE_IDLE


def test_a_probe_may_stream_before_it_is_calibrated_and_its_poses_say_so():
    bench = Bench().find_sensor()
    bench.command(lib.COMMAND_START)
    bench.run(3)
    flags = [
        pose.fields["pose_flags"] & lib.POSE_UNCALIBRATED for pose in bench.of("pose")
    ]
    assert all(flags[:255])
    assert not any(flags[256:])


def test_a_calibration_refused_for_motion_is_told_once_in_5_seconds():
    bench = Bench().find_sensor()
    moving = REST.copy()
    moving["gyr"][::2, 1] += 100
    bench.samples = iter(moving)
    bench.run(12)
    refusals = [
        message
        for message in bench.of("event")
        if message.fields["event"] == lib.EVENT_CALIBRATION_REFUSED
    ]
    assert all(refusal.fields["cause"] == lib.CAUSE_MOTION for refusal in refusals)
    # The span in counts: of the motion, and a little noise.
    assert all(90 < refusal.fields["detail"] < 115 for refusal in refusals)
    times = [refusal.time_us for refusal in refusals]
    assert len(times) == 3
    assert all(5_000_000 <= b - a <= 5_020_000 for a, b in pairwise(times))
    assert bench.state == lib.STATE_CALIBRATING
    bench.samples = iter(REST)
    bench.run(2.6)
    assert bench.state == lib.STATE_IDLE


def test_a_fault_ends_the_stream_until_the_sensor_is_back():
    bench = streaming(1)
    bench.fail()
    assert bench.events()[-1] == (lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 3)
    assert bench.state == lib.STATE_FAULT
    bench.run(1.1, samples=False)
    fields = bench.of("status")[-1].fields
    assert (fields["state"], fields["bus_faults"], fields["bus_recoveries"]) == (
        lib.STATE_FAULT,
        1,
        0,
    )
    bench.find_sensor()
    assert bench.events()[-1] == (lib.EVENT_BUS_RECOVERED, lib.CAUSE_NONE, 1)
    assert bench.messages[-1].name == "hello"
    assert bench.state == lib.STATE_STREAMING
    poses = len(bench.of("pose"))
    bench.run(1)
    assert len(bench.of("pose")) == poses + 100
    assert bench.of("status")[-1].fields["bus_recoveries"] == 1


def test_a_sample_lost_on_the_bus_is_told_and_nothing_else():
    bench = streaming(1)
    bench.fail(is_over=False)
    assert bench.state == lib.STATE_STREAMING
    assert bench.events()[-1] == (lib.EVENT_BUS_FAULT, lib.CAUSE_NACK, 3)
    bench.run(1)
    fields = bench.of("status")[-1].fields
    assert (fields["bus_faults"], fields["bus_recoveries"]) == (1, 0)


def test_a_sensor_that_is_not_found_at_first_is_a_fault_and_a_recovery():
    bench = Bench()
    bench.fail()
    assert bench.state == lib.STATE_FAULT
    bench.run(1, samples=False)
    bench.find_sensor()
    assert bench.events()[-1] == (lib.EVENT_BUS_RECOVERED, lib.CAUSE_NONE, 1)
    bench.run(3)
    assert bench.state == lib.STATE_IDLE


def test_a_calibration_outlives_a_fault():
    bench = streaming(0)
    bench.fail()
    bench.find_sensor()
    bench.command(lib.COMMAND_STOP)
    assert bench.state == lib.STATE_IDLE


# The button.

BOUNCES = {
    "clean": [],
    "one": [1],
    "many": [1, 1, 2, 1, 3, 2, 5, 1, 1, 4],
    "long": [20, 30, 40, 45],
    "hundreds": [1] * 201,
}


def bounce(bench: Bench, is_down: bool, spells_ms: list[int]) -> None:
    """Changes to a level through spells that begin with it and alternate."""
    level = is_down
    for spell in spells_ms:
        bench.hold(level, spell)
        level = not level
    bench.hold(is_down, 120)


@pytest.mark.parametrize("pressing", BOUNCES.values(), ids=BOUNCES)
@pytest.mark.parametrize("releasing", BOUNCES.values(), ids=BOUNCES)
def test_a_click_toggles_the_stream_once_however_it_bounces(pressing, releasing):
    bench = Bench().find_sensor().run(3)
    count = len(bench.events())
    for event in (lib.EVENT_STREAM_STARTED, lib.EVENT_STREAM_STOPPED):
        bounce(bench, True, pressing)
        bounce(bench, False, releasing)
        assert bench.events()[count:] == [
            (lib.EVENT_BUTTON_PRESSED, lib.CAUSE_BUTTON, 0),
            (lib.EVENT_BUTTON_RELEASED, lib.CAUSE_BUTTON, 0),
            (event, lib.CAUSE_BUTTON, 0),
        ]
        count += 3
    assert bench.state == lib.STATE_IDLE


def test_a_button_that_is_only_touched_does_nothing():
    bench = Bench().find_sensor().run(3)
    count = len(bench.events())
    for _ in range(20):
        bench.hold(True, 49)
        bench.hold(False, 60)
    assert len(bench.events()) == count


def test_button_and_commands_stop_what_the_other_started():
    bench = Bench().find_sensor().run(3)
    bench.click()
    assert bench.command(lib.COMMAND_STOP) == (OK, [0, 0])
    bench.command(lib.COMMAND_START)
    bench.click()
    streams = [
        (event, cause)
        for event, cause, _ in bench.events()
        if event in (lib.EVENT_STREAM_STARTED, lib.EVENT_STREAM_STOPPED)
    ]
    assert streams == [
        (lib.EVENT_STREAM_STARTED, lib.CAUSE_BUTTON),
        (lib.EVENT_STREAM_STOPPED, lib.CAUSE_COMMAND),
        (lib.EVENT_STREAM_STARTED, lib.CAUSE_COMMAND),
        (lib.EVENT_STREAM_STOPPED, lib.CAUSE_BUTTON),
    ]


# Settings.


def test_rates_and_fields_outlive_a_reboot_and_boots_are_counted():
    memory = Memory()
    bench = Bench(memory).run(3, samples=False)
    identity = bench.of("hello")[0].fields["probe_id"]
    bench.command(lib.COMMAND_RATE, 0, 33)
    bench.command(lib.COMMAND_RATE, 1, 44)
    bench.command(lib.COMMAND_FIELDS, lib.STREAM_RAW)
    bench.run(4, samples=False)
    for boots in (2, 3, 4):
        bench = Bench(memory, entropy=boots)
        fields = bench.of("hello")[0].fields
        assert (fields["pose_rate"], fields["raw_rate"]) == (33, 44)
        assert fields["boot_count"] == boots
        assert fields["probe_id"] == identity
        bench.find_sensor()
        bench.command(lib.COMMAND_START)
        bench.run(4)
        assert len(bench.of("raw")) == 4 * 44
        assert not bench.of("pose")


def test_the_first_boot_alone_tells_that_the_defaults_were_taken():
    memory = Memory()
    restored = (lib.EVENT_SETTINGS_RESTORED, lib.CAUSE_BOOT, lib.SETTINGS_NONE)
    assert Bench(memory).run(4, samples=False).events() == [restored]
    assert Bench(memory).run(4, samples=False).events() == []


def test_a_memory_that_keeps_nothing_is_told_and_the_probe_works_on():
    memory = Memory()
    memory.is_broken = True
    bench = Bench(memory).find_sensor().run(4)
    events = [event for event, *_ in bench.events()]
    assert events.count(lib.EVENT_SETTINGS_FAILED) == 1
    assert bench.state == lib.STATE_IDLE
    assert bench.command(lib.COMMAND_RATE, 0, 20) == (OK, [0, 20])
    bench.run(4)
    events = [event for event, *_ in bench.events()]
    assert events.count(lib.EVENT_SETTINGS_FAILED) == 2


def test_an_id_is_made_of_chance_where_the_silicon_has_none():
    made = {bytes(Bench(entropy=chance).c.settings.probe_id) for chance in range(50)}
    assert len(made) == 50


def test_an_id_is_not_all_zeros_even_where_chance_makes_it_so():
    # Sixteen readings a word: fifteen zeros, then the one that makes its CRC zero.
    readings = [0] * 60
    for word in range(1, 5):
        crc = wire.crc(word, b"\0" * 30)
        readings.append(
            next(r for r in range(2**16) if not wire.crc(crc, r.to_bytes(2, "little")))
        )

    class Unlucky(Bench):
        def _entropy(self) -> int:
            return readings.pop(0)

    assert any(Unlucky().c.settings.probe_id)
    assert not readings


def test_an_id_of_the_silicon_is_taken_as_it_is_and_kept():
    memory = Memory()
    bench = Bench(memory, unique_id=b"\x01\x23\x45\x67\x89\xab\xcd\xef")
    assert bytes(bench.c.settings.probe_id).hex() == "0123456789abcdef"
    bench.run(4, samples=False)
    again = Bench(memory)
    assert bytes(again.c.settings.probe_id).hex() == "0123456789abcdef"


# The light.


def light(bench: Bench) -> list[tuple[bool, int]]:
    """Levels and how many milliseconds each stands, over 2 s from a whole 2 s on."""
    runs: list[tuple[bool, int]] = []
    for millisecond in range(2000):
        level = bool(lib.probe_led(bench.c, 10_000_000 + 1000 * millisecond))
        if runs and runs[-1][0] == level:
            runs[-1] = (level, runs[-1][1] + 1)
        else:
            runs.append((level, 1))
    return runs


def test_the_light_shows_each_state():
    bench = Bench()
    assert light(bench) == [(True, 100), (False, 100)] * 10
    bench.find_sensor().run(3)
    assert light(bench) == [(True, 50), (False, 1950)]
    bench.command(lib.COMMAND_START)
    assert light(bench) == [(True, 2000)]
    bench.fail()
    twice = [(True, 80), (False, 120), (True, 80), (False, 720)]
    assert light(bench) == twice * 2
    bench.find_sensor()
    assert light(bench) == [(True, 2000)]
