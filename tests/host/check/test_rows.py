# SPDX-License-Identifier: MIT
"""The rows of `imud check`, from what a board says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from check_bench import F405, HELLO, G, evidence, raws, rows, troubles
from imud.calibration.earth import Earth
from imud.calibration.noise import with_noise
from imud.check.evidence import Evidence, Wire
from imud.check.judge import judged
from imud.check.readings import MG
from imud.check.rows import RowVerdict, overall, summary
from imud.check.wire import clock_ppm
from imud.params.value import Params

LOOK, FAULT = RowVerdict.LOOK, RowVerdict.FAULT


def test_a_healthy_board_has_no_line_but_good_ones() -> None:
    found = evidence(samples=raws(ppm=-12.0))
    assert troubles(found) == {}
    assert overall(judged(found)) is RowVerdict.GOOD
    assert rows(found)["self-test gyroscope"].measured == "passed"
    assert rows(found)["range register"].verdict is RowVerdict.GOOD


def test_what_was_not_judged_is_named_beside_a_good_verdict() -> None:
    table = judged(evidence())
    assert overall(table) is RowVerdict.GOOD
    assert summary(table).startswith("not judged: clock; ")


@pytest.mark.parametrize(
    ("board", "ppm", "verdict", "words"),
    [
        ({}, 30.0, RowVerdict.GOOD, "(as a crystal)"),
        ({}, -3200.0, RowVerdict.GOOD, "(a ceramic resonator)"),
        ({}, 9000.0, LOOK, "ppm"),
        ({}, 30000.0, FAULT, "ppm"),
        (F405, 40.0, RowVerdict.GOOD, "ppm"),
        (F405, 900.0, LOOK, "ppm"),
    ],
)
def test_a_resonator_is_normal_for_a_nano_and_not_for_a_pyboard(
    board: dict[str, Any], ppm: float, verdict: RowVerdict, words: str
) -> None:
    found = evidence(samples=raws(ppm=ppm, bound_us=100.0), hello=board)
    row = rows(found)["clock"]
    assert row.verdict is verdict
    assert words in row.measured
    assert row.numbers["ppm"] == pytest.approx(ppm, abs=row.numbers["bound_ppm"] + 1)


def test_a_clock_is_only_as_bad_as_its_bound_allows() -> None:
    found = evidence(samples=raws(ppm=900.0, bound_us=6000.0), hello=F405)
    row = rows(found)["clock"]
    assert row.numbers["bound_ppm"] == pytest.approx(1090.0, rel=0.1)
    assert row.verdict is RowVerdict.GOOD


def test_a_log_gives_a_clock_without_a_bound() -> None:
    found = clock_ppm(evidence(samples=raws(ppm=50.0, bound_us=None)).samples())
    assert found[0] == pytest.approx(50.0, abs=0.1)
    assert found[1] is None


@pytest.mark.parametrize(
    ("change", "name", "verdict", "words"),
    [
        ({"acc": (0.0, 0.0, 1.16)}, "accelerometer offset", LOOK, "z 160 mg"),
        ({"acc": (0.0, 0.0, 0.2)}, "accelerometer offset", FAULT, "z -800 mg"),
        ({"gyr": (0.0, 7.0, 0.0)}, "gyroscope offset", LOOK, "y 7.00"),
        ({"gyr": (0.0, 0.0, -40.0)}, "gyroscope offset", FAULT, "z -40"),
        ({"gyr_noise_dps": 0.25}, "gyroscope noise", LOOK, "deg/s rms"),
        ({"gyr_noise_dps": 0.8}, "gyroscope noise", FAULT, "deg/s rms"),
        ({"acc_noise_mg": 20.0}, "accelerometer noise", LOOK, "mg rms"),
        ({"temperature_c": 71.0}, "temperature", LOOK, "71.0 degC"),
        ({"temperature_c": 100.0}, "temperature", FAULT, "100.0 degC"),
        ({"temperature_c": None}, "temperature", LOOK, "no reading"),
        ({"mag": (0.1, 0.1, 0.1)}, "field", LOOK, "0 uT"),
        ({"mag": (150.0, 0.0, 0.0)}, "field", LOOK, "150 uT"),
        ({"mag": None}, "magnetometer", FAULT, "measures nothing"),
        ({"rate_hz": 187.0}, "sample rate", LOOK, "187.0"),
        ({"rate_hz": 150.0}, "sample rate", FAULT, "150.0"),
        ({"flags": ("gap",)}, "missed samples", LOOK, "2400 gaps"),
        ({"gyr_noise_dps": 3.0}, "rest", LOOK, "0.0 s"),
    ],
    ids=str,
)
def test_readings_that_are_not_normal_have_a_line_with_the_number(
    change: dict[str, Any], name: str, verdict: RowVerdict, words: str
) -> None:
    found = evidence(samples=raws(**change), self_test={})
    assert troubles(found) == {name: verdict}
    assert words in rows(found)[name].measured
    assert rows(found)[name].advice


@pytest.mark.parametrize(("name", "own"), [("gyr", 0.07), ("acc", 5.0)])
@pytest.mark.parametrize("times", [1.0, 1.45, 3.0])
def test_noise_is_compared_with_that_of_the_calibration(
    name: str, own: float, times: float
) -> None:
    key = {"gyr": "gyroscope noise", "acc": "accelerometer noise"}[name]
    found = evidence(samples=raws())
    assert "times" not in rows(found)[key].numbers
    # White noise at 200 Hz, in the root of a Hz.
    si = own * (np.radians(1.0) if name == "gyr" else MG)
    found.params = with_noise(Params(), {name: si / 10.0 / times}).encode()
    row = rows(found)[key]
    assert row.numbers["times"] == pytest.approx(times, rel=0.1)
    assert row.verdict is (LOOK if times > 2.0 else RowVerdict.GOOD)
    assert row.advice.startswith("it is 3.1 times as noisy") == (times > 2.0)
    found.hello["sample_rate"] = 400  # of which only half were sent
    assert "times" not in rows(found)[key].numbers


def test_an_own_field_of_an_uncalibrated_module_is_normal() -> None:
    row = rows(evidence(samples=raws(mag=(60.0, 60.0, -60.0))))["field"]
    assert row.verdict is RowVerdict.GOOD
    assert "not calibrated" in row.measured
    assert "15 to 45 uT of the module's own" in row.normal


@pytest.mark.parametrize(
    ("norm_ut", "verdict"), [(49.0, RowVerdict.GOOD), (75.0, LOOK)]
)
def test_a_calibrated_field_is_compared_with_that_of_the_place(
    norm_ut: float, verdict: RowVerdict
) -> None:
    dip = np.radians(66.0)
    field = [0.0, norm_ut * np.cos(dip), -norm_ut * np.sin(dip)]
    samples = raws(mag=(90.0, 10.0, -44.0), mag_uT=field)
    found = evidence(samples=samples)
    found.earth = Earth(norm_uT=49.5, dip_deg=66.5, declination_deg=5.0)
    row = rows(found)["field"]
    assert row.verdict is verdict
    assert "66 deg dip" in row.measured


@pytest.mark.parametrize("sensor", ["acc", "gyr"])
@pytest.mark.parametrize("axis", range(3))
def test_an_axis_that_never_changes_is_named(sensor: str, axis: int) -> None:
    samples = raws()
    for each in samples:
        counts = list(each[f"{sensor}_counts"])
        counts[axis] = 17 if (sensor, axis) != ("acc", 2) else G
        each[f"{sensor}_counts"] = tuple(counts)
    row = rows(evidence(samples=samples))["stuck axes"]
    name = {"acc": "accelerometer", "gyr": "gyroscope"}[sensor]
    assert (row.verdict, row.measured) == (FAULT, f"{name} {'xyz'[axis]}")


def test_numbers_that_stand_still_for_a_second_are_a_chip_that_hung() -> None:
    samples = raws()
    for each in samples[600:900]:
        same = ("acc_counts", "gyr_counts")
        each |= {name: samples[600][name] for name in same}
    row = rows(evidence(samples=samples))["stuck axes"]
    assert (row.verdict, row.measured) == (FAULT, "all")


def test_a_reading_at_the_end_of_the_range_is_counted() -> None:
    samples = raws()
    samples[700]["gyr_counts"] = (-32768, 0, 0)
    row = rows(evidence(samples=samples))["saturation"]
    assert (row.verdict, row.measured) == (LOOK, "1 of 2400 samples")


def test_a_tone_is_named_with_those_that_look_the_same() -> None:
    samples = raws()
    for number, sample in enumerate(samples):
        x, y, z = sample["acc_counts"]
        turn = 2.0 * math.pi * 153.0 * number / 200.0  # seen at 47 Hz
        sample["acc_counts"] = (x + round(60.0 * math.sin(turn)), y, z)
    row = rows(evidence(samples=samples))["vibration"]
    assert row.verdict is LOOK
    assert row.numbers["hz"] == pytest.approx(47.0, abs=0.1)
    assert row.numbers["mg_rms"] == pytest.approx(20.7, rel=0.1)  # 60 counts
    assert "153.0, 247.0" in row.advice
    assert "vibration" not in rows(evidence(samples=raws()))


@pytest.mark.parametrize(
    ("event", "name", "words"),
    [
        (("sensor_fault", "registers", 0x1C71), "configuration", "register 0x1C"),
        (("sensor_fault", "mag_stuck", 0x71), "magnetometer", "blocks its bus"),
        (("sensor_fault", "mag_silent", 0x71), "magnetometer", "measures nothing"),
        (("clock_failed", "crystal", 0), "clock", "internal oscillator"),
        (("battery_low", "battery", 3100), "supply", "V"),
    ],
)
def test_an_event_appears_in_the_row_of_its_cause(
    event: tuple[str, str, int], name: str, words: str
) -> None:
    row = rows(evidence(events=(event,)))[name]
    assert row.verdict is FAULT
    assert words in row.measured
    assert row.advice


@pytest.mark.parametrize(
    ("who_am_i", "sensor", "expected"),
    [
        ((0x73, 0x48), "mpu9250", {}),
        ((0x70, 0), "mpu6500", {"inertial chip": LOOK, "magnetometer": FAULT}),
        ((0x71, 0), "mpu9250", {"magnetometer": FAULT}),
        ((0x75, 0x48), "mpu9250", {"inertial chip": LOOK}),
        ((0x6C, 0x3D), "lsm6dsox", {}),
        ((0x6B, 0x3D), "lsm6dsox", {"accelerometer noise": LOOK}),
        ((0x6C, 0), "lsm6dsox", {"magnetometer": FAULT}),
        (
            *((0x70, 0x3D), "lsm6dsv16x"),
            {"inertial chip": LOOK, "accelerometer noise": LOOK},
        ),
    ],
)
def test_a_chip_is_named_by_its_identity(
    who_am_i: tuple[int, int], sensor: str, expected: dict[str, RowVerdict]
) -> None:
    mag = (10.0, 20.0, -44.0) if who_am_i[1] else None
    found = evidence(
        samples=raws(mag=mag), hello={"who_am_i": who_am_i, "sensor": sensor}
    )
    assert troubles(found) == expected


def test_a_self_test_that_failed_is_a_fault_with_its_number() -> None:
    weak = {"stimulated": (6500, 6900, 22800, 900, -7900, 8150)}
    found = evidence(self_test=weak)
    assert troubles(found) == {"self-test gyroscope": FAULT}
    assert "x response 7 deg/s" in rows(found)["self-test gyroscope"].measured


def test_without_responses_the_daemons_verdict_counts() -> None:
    found = evidence(self_test={})
    assert rows(found)["self-test gyroscope"].verdict is RowVerdict.SKIPPED
    found.outcomes = {"gyroscope": {"outcome": "failed", "reason": "x response 7"}}
    assert rows(found)["self-test gyroscope"].verdict is FAULT


def test_readings_that_do_not_follow_the_range_register_are_a_fault() -> None:
    eighth = {
        "before": (-2, 42, 2048, 15, -9, 131),
        "after": (-2, 42, 2048, 14, -8, 130),
        "stimulated": (810, 862, 2850, 8000, -7900, 8150),
    }
    row = rows(evidence(self_test=eighth))["range register"]
    assert (row.verdict, row.measured) == (
        FAULT,
        "0.13 g at 2 g full scale, 1.00 g as set",
    )


@pytest.mark.parametrize(
    ("supply_mv", "verdict"),
    [(5500, RowVerdict.GOOD), (4100, LOOK), (3700, FAULT), (6200, LOOK)],
)
def test_a_nano_needs_its_five_volts(supply_mv: int, verdict: RowVerdict) -> None:
    assert rows(evidence(status={"supply": supply_mv}))["supply"].verdict is verdict


@pytest.mark.parametrize(
    ("status", "name"),
    [
        ({"messages_dropped": 3}, "messages lost"),
        ({"receive_lost": 5}, "messages lost"),
        ({"overruns": 2}, "missed samples"),
        ({"bus_faults": 3}, "sensor bus"),
    ],
)
def test_what_a_probe_counts_has_its_line(status: dict[str, int], name: str) -> None:
    assert troubles(evidence(status=status)) == {name: LOOK}


def test_what_was_counted_before_the_check_is_not_held_against_the_wire() -> None:
    found = Evidence()
    found.add_message(evidence().counters | {"type": "status", "messages_dropped": 9})
    found.add_message(evidence().counters | {"type": "status", "messages_dropped": 9})
    assert found.rise("messages_dropped") == 0


def test_a_brown_out_is_a_fault() -> None:
    found = evidence()
    found.add_message(HELLO | {"boot_count": 8, "reset_cause": ["brown_out"]})
    row = rows(found)["start"]
    assert row.verdict is FAULT
    assert "supply drops out" in row.advice


def test_a_firmware_of_another_schema_is_the_only_line() -> None:
    found = Evidence(is_live=True)
    hello = {name: value for name, value in HELLO.items() if name != "type"}
    found.add_status(
        {
            "hello": hello | {"schema_fingerprint": 0x01234567},
            "state": "other schema",
            "counters": {},
        }
    )
    assert troubles(found) == {"firmware": FAULT}
    assert "flash the matching image" in rows(found)["firmware"].advice


@pytest.mark.parametrize(("timer_ms", "expected"), [(1, {}), (16, {"port": LOOK})])
def test_an_adapter_that_gathers_bytes_is_named(
    timer_ms: int, expected: dict[str, RowVerdict]
) -> None:
    found = evidence(samples=raws(ppm=0.0))
    found.is_live = True
    found.wire = Wire("USB, FT232R (0403:6001)", latency_timer_ms=timer_ms)
    assert troubles(found) == expected


@pytest.mark.parametrize(
    ("pressed", "sees", "expected"),
    [
        (True, True, {}),
        (None, None, {}),
        (False, False, {"button": LOOK, "LED": LOOK}),
    ],
)
def test_a_button_that_is_not_seen_and_a_dark_led_are_lines(
    pressed: bool | None, sees: bool | None, expected: dict[str, RowVerdict]
) -> None:
    found = evidence(samples=raws(ppm=0.0))
    found.is_live = True
    found.wire = Wire("USB, CH340 (1a86:7523)")
    found.button, found.led = pressed, sees
    assert troubles(found) == expected
