# SPDX-License-Identifier: MIT
"""The reactions of the STM32F405's firmware to faults of its I2C bus and hardware."""

from __future__ import annotations

from typing import Any

import pytest

from letters import FAILED_BURSTS, NACK, OK, STUCK, Board

pytestmark = pytest.mark.sampled(3)


@FAILED_BURSTS
def test_a_failed_burst_is_reported_once_and_sampling_goes_on_after_recovery(
    board: Board, fault: dict[str, Any], failures: set[int]
) -> None:
    run = board((100, "uswttpvso"), seconds=0.5, faults=[fault | {"transaction": 4}])
    first, second = run.numbers("took")
    assert first[-2] == -1
    assert first[-1] in failures
    assert second[-2] == 1
    assert run.numbers("recover")[0][0] == OK
    assert len(run.words("sample")) == 1


def test_a_misplaced_start_fails_its_burst(board: Board) -> None:
    # Somewhere in a period of 2.6 ms there is a reading of 0.75.
    glitches = [{"kind": "glitch", "at_us": 112000 + 90 * n} for n in range(30)]
    run = board((100, "us"), (117, "t"), (118, "tpvs"), seconds=0.2, faults=glitches)
    first, second = run.numbers("took")
    assert first[0] + second[0] >= 1
    assert {STUCK, NACK} & {first[-1], second[-1]}
    assert run.numbers("recover")[0][0] == OK


# A period, in which there is one reading.
PERIOD_US = range(109_000, 111_700, 37)


def readings(board: Board, kind: str, at_us: int) -> tuple[bool, list[list[str]]]:
    """Whether I2C1 has told a bus error, and the first five readings, if they came."""
    faults = [{"kind": kind, "at_us": at_us}]
    run = board((100, "usooooo"), seconds=0.12, faults=faults)
    return "i2c_bus_errors" in run.summary, run.words("sample")


def test_a_reading_torn_by_a_misplaced_start_is_never_handed_over(board: Board) -> None:
    expected = board((100, "usooooo"), seconds=0.12).words("sample")
    assert len(expected) == 5
    hits = failures = 0
    for at_us in PERIOD_US:
        is_hit, samples = readings(board, "glitch", at_us)
        assert samples == expected[: len(samples)]
        assert is_hit or len(samples) == 5
        hits += is_hit
        failures += len(samples) < 5
    # In the byte of an address the sensor is lost to the master only until its end.
    assert hits >= 15
    assert failures >= hits / 2


def test_a_bus_error_that_did_not_happen_changes_no_reading(board: Board) -> None:
    """Few lose one: those in its last byte, where a device that has dropped out would
    look the same.
    """
    expected = board((100, "usooooo"), seconds=0.12).words("sample")
    hits = failures = 0
    for at_us in PERIOD_US:
        is_hit, samples = readings(board, "spurious_berr", at_us)
        assert samples == expected[: len(samples)]
        hits += is_hit
        failures += len(samples) < 5
    assert hits >= 15
    assert failures <= hits / 5


@pytest.mark.parametrize(
    ("letters", "expected"),
    [
        ("r", ["0", "d4"]),
        ("u2", ["0", "8f20"]),
        ("u3", ["0", "8f2000"]),
        ("u4", ["0", "8f200000"]),
        ("n", ["-1", "00"]),
    ],
)
def test_a_polled_transfer_goes_on_after_bus_errors_that_did_not_happen(
    board: Board, letters: str, expected: list[str]
) -> None:
    # From the letter on for longer than set-up and reading take.
    errors = [{"kind": "spurious_berr", "at_us": 100_020 + 17 * n} for n in range(32)]
    quiet = board((100, letters), seconds=0.2)
    noisy = board((100, letters), seconds=0.2, faults=errors)
    assert noisy.summary["i2c_bus_errors"] >= 1
    assert quiet.words("read")[0][:2] == noisy.words("read")[0][:2] == expected
    assert quiet.numbers("set up") == noisy.numbers("set up")
