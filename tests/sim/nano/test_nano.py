# SPDX-License-Identifier: MIT
"""The virtual Nano as a program: runs, EEPROM, power and summary.

The firmware is tests/sim/nano/desk.c. tests/system tests the real image.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from nano_desk import (
    ASLEEP,
    BOOT,
    DEEP,
    EEPROM,
    FLOOD,
    SAMPLES,
    TOO_MUCH,
    WILD,
    WORK,
    faults,
    image,
    run,
)


@pytest.fixture(scope="module")
def desk() -> Path:
    return image()


def test_bytes_come_back_and_time_is_kept(desk: Path, tmp_path: Path) -> None:
    data, summary = run(
        desk, tmp_path, "--seconds", "0.5", "--send", "100000:48656c6c6f00"
    )
    assert data == BOOT + b"Hello\x00"
    assert summary["frames"] == 2
    assert summary["bytes"] == len(data)
    assert summary["seconds"] == pytest.approx(0.5, abs=1e-5)
    assert summary["motion_start_us"] == 100_000
    assert summary["crashed"] is False
    assert summary["resets"] == 0


def test_the_button_is_down_when_told(desk: Path, tmp_path: Path) -> None:
    data, _ = run(
        desk,
        tmp_path,
        *("--seconds", "1", "--press", "100000:200000", "--press", "300000:300050"),
        *("--send", "150000:31", "--send", "250000:32"),
    )
    assert data == BOOT + b"D1U2DU"


def test_marked_work_is_measured_to_the_cycle(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "0.2", "--send", f"1000:{WORK:x}{WORK:x}"
    )
    assert summary["samples"] == 2
    assert summary["cycles_mean"] == 1000
    assert summary["cycles_worst"] == 1000


def test_work_that_fits_is_never_late(desk: Path, tmp_path: Path) -> None:
    _, summary = run(desk, tmp_path, "--seconds", "1", "--send", f"200000:{SAMPLES:x}")
    assert summary["samples"] == 100
    assert summary["data_ready"] in (100, 101)
    assert summary["late"] == 0
    assert summary["cycles_mean"] == pytest.approx(40_000, abs=8)
    assert summary["sensor_complaint"] is None


def test_work_that_does_not_fit_is_late(desk: Path, tmp_path: Path) -> None:
    _, summary = run(desk, tmp_path, "--seconds", "2", "--send", f"200000:{TOO_MUCH:x}")
    assert summary["samples"] == 100
    # 5.5 ms of work and 0.5 ms of burst: five of six edges in 30 ms are served.
    assert summary["data_ready"] >= 115
    missed = summary["data_ready"] - summary["samples"]
    # Each edge without work counts, and so does the sample whose work ran over it.
    assert missed - 1 <= summary["late"] <= 2 * missed + 1


def test_the_deepest_stack_is_found(desk: Path, tmp_path: Path) -> None:
    _, shallow = run(desk, tmp_path, "--seconds", "0.1")
    _, deep = run(desk, tmp_path, "--seconds", "0.1", "--send", f"1000:{DEEP:x}")
    assert 0 < shallow["stack_max"] < 30
    assert 300 <= deep["stack_max"] <= 340


def test_a_crash_ends_the_run_with_its_place(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "9", "--send", f"1000:{WILD:x}", code=1
    )
    assert summary["crashed"] is True
    assert summary["seconds"] < 0.1
    assert 0 < summary["crash_pc"] < 2000
    assert 0x800 < summary["crash_sp"] <= 0x8FF


def test_sleep_with_interrupts_off_is_a_crash(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "9", "--send", f"1000:{ASLEEP:x}", code=1
    )
    assert summary["crashed"] is True


def test_runs_are_the_same_byte_for_byte(desk: Path, tmp_path: Path) -> None:
    more = ("--seconds", "2", "--send", f"1000:{FLOOD:x}", "--press", "50000:90000")
    assert run(desk, tmp_path, *more) == run(desk, tmp_path, *more)


# EEPROM and power


def test_eeprom_starts_erased_and_is_kept(desk: Path, tmp_path: Path) -> None:
    eeprom = tmp_path / "eeprom"
    run(desk, tmp_path, "--seconds", "0.05", "--eeprom", str(eeprom))
    assert eeprom.read_bytes() == b"\xff" * 1024
    more = ("--seconds", "0.1", "--eeprom", str(eeprom))
    _, summary = run(desk, tmp_path, *more, "--send", f"1000:{EEPROM:x}")
    assert eeprom.read_bytes()[6:14] == bytes.fromhex("ffffa0a1a2a3ffff")
    assert summary["eeprom_writes"] == 4
    run(desk, tmp_path, *more)
    assert eeprom.read_bytes()[6:14] == bytes.fromhex("ffffa0a1a2a3ffff")


@pytest.mark.parametrize("write", [1, 2, 3, 4])
def test_power_can_be_cut_at_each_write(desk: Path, tmp_path: Path, write: int) -> None:
    eeprom = tmp_path / "eeprom"
    cut = {"kind": "power_cut", "write": write, "after_us": 2600}
    _, summary = run(
        desk,
        tmp_path,
        *("--seconds", "1", "--eeprom", str(eeprom), "--send", f"1000:{EEPROM:x}"),
        *("--faults", faults(tmp_path, cut)),
    )
    cells = eeprom.read_bytes()[8:12]
    whole = bytes(range(0xA0, 0xA4))
    assert summary["power_cut"] is True
    assert summary["eeprom_writes"] == write
    assert cells[: write - 1] == whole[: write - 1]
    assert cells[write - 1] & whole[write - 1] == whole[write - 1]
    assert cells[write - 1] != whole[write - 1]
    assert cells[write:] == b"\xff" * (4 - write)


def test_resets_leave_their_cause(desk: Path, tmp_path: Path) -> None:
    data, summary = run(
        desk,
        tmp_path,
        *("--seconds", "0.3", "--faults"),
        faults(
            tmp_path,
            {"kind": "reset", "at_us": 100_000},
            {"kind": "brown_out", "at_us": 200_000},
        ),
    )
    assert data == BOOT + b"R\x02\x00R\x04\x00"
    assert summary["resets"] == 2
