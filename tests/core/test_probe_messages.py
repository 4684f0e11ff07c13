# SPDX-License-Identifier: MIT
"""A probe's periodic messages, and the numbering of all messages."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from core.desk import lib
from core.probe_bench import (
    MPU9250,
    NAMES,
    REST,
    SAMPLE_US,
    SECOND_US,
    STEP_US,
    Bench,
    callbacks,
    sequences_of,
    streaming,
)
from protocol import wire

# Hello and status.


def test_the_first_message_is_a_hello_that_tells_board_and_build():
    bench = Bench(reset_cause=lib.RESET_CAUSE_BROWN_OUT, start_us=1234)
    hello = bench.messages[0]
    assert (hello.name, hello.sequence, hello.time_us) == ("hello", 0, 1234)
    fields = hello.fields
    assert fields["protocol_version"] == lib.PROTOCOL_VERSION
    assert fields["schema_fingerprint"] == lib.SCHEMA_FINGERPRINT
    assert fields["firmware"] == "0.1.0+unreleased-build"[:16]
    assert fields["board"] == lib.BOARD_F405
    assert fields["reset_cause"] == lib.RESET_CAUSE_BROWN_OUT
    assert fields["boot_count"] == 1
    assert (fields["pose_rate"], fields["raw_rate"]) == (100, 200)
    assert (fields["sensor"], fields["sample_rate"]) == (lib.SENSOR_NONE, 0)


def test_a_hello_is_read_under_any_schema_and_a_status_is_not():
    bench = Bench()
    other = wire.Decoder(lib.SCHEMA_SEED ^ 0x1234)
    found: list[Any] = []

    def send(data: Any, length: int) -> bool:
        found.extend(other.feed(bytes(data[0:length])))
        return True

    replaced = callbacks("struct outlet", put=send)
    bench.wire.put = replaced["put"]
    bench.run(1.2, samples=False)
    assert [item if isinstance(item, str) else NAMES[item[0]] for item in found] == [
        "hello",
        "bad_crc",  # params, once the first settings are written
        "bad_crc",  # status
    ]


def test_a_found_sensor_is_told_at_once_with_its_units():
    bench = Bench().find_sensor()
    assert [message.name for message in bench.messages] == ["hello", "event", "hello"]
    fields = bench.messages[-1].fields
    assert fields["sensor"] == lib.SENSOR_MPU9250
    assert (fields["who_am_i"], fields["mag_adjust"]) == ([0x71, 0x48], [170, 180, 160])
    assert fields["sample_rate"] == 200
    assert fields["acc_lsb"] == MPU9250.acc_lsb_nm_s2
    assert fields["gyr_lsb"] == MPU9250.gyr_lsb_nrad_s
    assert fields["mag_lsb"] == MPU9250.mag_lsb_pt


@pytest.mark.parametrize("start_us", [0, 2**32 - 4_300_000])
def test_hello_and_status_come_each_second_half_a_second_apart(start_us):
    bench = Bench(start_us=start_us).run(10, samples=False)
    statuses = bench.of("status")
    hellos = bench.of("hello")[1:]
    assert len(statuses) == len(hellos) == 10
    for second, (hello, status) in enumerate(zip(hellos, statuses, strict=True)):
        begun = start_us + second * SECOND_US
        assert hello.time_us == (begun + SECOND_US // 2) % 2**32
        assert status.time_us == (begun + SECOND_US) % 2**32
        assert status.fields["uptime"] == second + 1


def stuck_in_work(bench: Bench) -> None:
    """From here on every sample has a field and a pose."""
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.samples = (row for row in REST if row["has_mag"])
    bench.run(4.2)


def stopped_in_work(bench: Bench) -> None:
    """The stream ends, and with it the poses that were most of the work."""
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.command(lib.COMMAND_STOP)
    bench.run(4.2)


def failed_in_work(bench: Bench) -> None:
    """The sensor fails, and no sample comes any more."""
    bench.command(lib.COMMAND_RATE, 0, 200)
    bench.fail()
    bench.run(4.2, samples=False)


@pytest.mark.parametrize("situation", [stuck_in_work, stopped_in_work, failed_in_work])
def test_messages_and_saves_do_not_wait_for_samples(situation):
    bench = streaming(1)
    begun = bench.time_us
    situation(bench)
    for name in ("hello", "status"):
        times = [m.time_us for m in bench.of(name) if m.time_us > begun]
        assert len(times) == 4
        assert all(time_us % (SECOND_US // 2) <= STEP_US for time_us in times)
    # A write is begun every two steps at the latest, a save takes 200 of them at most.
    bench.run(2, samples=False)
    again = Bench(bench.memory).of("hello")[0].fields
    assert again["pose_rate"] == 200


def test_seconds_that_nobody_stepped_through_are_made_up():
    bench = Bench().run(0.3, samples=False)
    bench.step(3_200_000)
    bench.run(1, samples=False)
    assert [m.fields["uptime"] for m in bench.of("status")] == [1, 2, 3, 4]


def test_a_status_counts_what_has_happened():
    bench = Bench()
    bench.supply_mv = 4987
    bench.find_sensor().run(0.5)
    bench.samples_ready += 2
    lib.probe_overrun(bench.c, 2, bench.time_us)
    for cycles in (40_000, 52_000, 46_001):
        lib.probe_worked(bench.c, cycles)
    bench.run(0.5)
    before = len(bench.messages) - 1
    fields = bench.of("status")[0].fields
    assert fields["state"] == lib.STATE_CALIBRATING
    # The status of a step comes before the step's sample.
    assert (fields["samples_read"], fields["samples_fused"]) == (199, 199)
    assert (fields["samples_ready"], fields["overruns"]) == (201, 2)
    assert fields["messages_sent"] == before + 1
    assert fields["messages_dropped"] == 0
    assert (fields["cycles_mean"], fields["cycles_worst"]) == (46_000, 52_000)
    assert (fields["stack_free"], fields["supply"]) == (777, 4987)
    assert (lib.EVENT_OVERRUN, lib.CAUSE_LATE, 2) in bench.events()
    # The load is of one second alone.
    bench.run(1)
    fields = bench.of("status")[1].fields
    assert (fields["cycles_mean"], fields["cycles_worst"]) == (0, 0)
    assert fields["messages_sent"] == bench.messages.index(bench.of("status")[1]) + 1
    lib.probe_worked(bench.c, 30_000)
    bench.run(1)
    fields = bench.of("status")[2].fields
    assert (fields["cycles_mean"], fields["cycles_worst"]) == (30_000, 30_000)


# Sequence numbers.


def test_sequence_numbers_have_no_hole_whatever_is_sent():
    bench = streaming(1)
    bench.command(lib.COMMAND_FIELDS, lib.STREAM_POSE | lib.STREAM_RAW)
    bench.run(1)
    bench.click()
    bench.fail()
    bench.find_sensor()
    bench.command(99)
    bench.run(1)
    assert sequences_of(bench) == list(range(len(bench.messages)))
    assert len(bench.messages) > 400
    assert {message.name for message in bench.messages} == {
        *("hello", "params", "status", "event", "reply", "raw", "pose")
    }


def test_a_refused_send_leaves_exactly_one_hole_and_is_counted():
    bench = streaming(0.5)
    stretches = []
    for stretch in (1, 3, 40):
        before = bench.refused
        bench.has_room = False
        while bench.refused < before + stretch:
            bench.run(SAMPLE_US / SECOND_US)
        bench.has_room = True
        stretches.append(bench.refused - before)
        bench.run(0.1)
    bench.run(1)
    sequences = sequences_of(bench)
    holes = [after - before - 1 for before, after in pairwise(sequences)]
    assert [hole for hole in holes if hole] == stretches
    status = bench.of("status")[-1]
    assert status.fields["messages_dropped"] == bench.refused == sum(stretches)
    assert status.fields["messages_sent"] + bench.refused == status.sequence + 1
