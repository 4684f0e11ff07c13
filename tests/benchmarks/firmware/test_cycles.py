# SPDX-License-Identifier: MIT
"""The tables of cycles: sums, limits, and filters that are held to their answers."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.common import images
from benchmarks.common.feed import Samples
from benchmarks.common.images import RunFailed
from benchmarks.firmware import budget, f405_load, filters
from benchmarks.firmware.filters import Filter, FilterFailed
from imud.rotation import FloatArray
from imud.virtual import sensors


def tally(inside: int, worst: int, in_worst: int, outside: int) -> dict[str, int]:
    return {"cycles": inside, "worst": worst, "in_worst": in_worst, "outside": outside}


def profile() -> dict[str, Any]:
    return {
        "samples": 10,
        "total": tally(1000, 130, 130, 50),
        "parts": {"a": tally(300, 60, 40, 0), "b": tally(700, 90, 90, 50)},
    }


def test_parts_come_by_their_mean_and_the_total_last() -> None:
    found = budget.by_part(profile())
    assert [(part.name, part.mean) for part in found] == [
        ("b", 70.0), ("a", 30.0), ("all", 100.0),
    ]  # fmt: skip
    assert [part.outside for part in found] == [5.0, 0.0, 5.0]


@pytest.mark.parametrize("kind", ["cycles", "in_worst", "outside"])
def test_parts_that_do_not_add_up_are_refused(kind: str) -> None:
    wrong = profile()
    wrong["parts"]["a"][kind] += 1
    with pytest.raises(budget.SumsDiffer, match=kind):
        budget.by_part(wrong)


SUMMARY = {
    "cycles_worst": 72_000,
    "cycles_mean": 50_000.0,
    "idle": 0.3,
    "late": 0,
    "samples": 100,
    "flash": 30_720,
    "ram": 1_352,
    "stack_max": 440,
}


@pytest.mark.parametrize(
    ("name", "lost"),
    [
        ("cycles_worst", 0), ("flash", 0), ("ram", 0), ("stack_max", 0), ("late", 0),
        ("samples", 1),
    ],
)  # fmt: skip
def test_one_more_than_a_limit_is_too_much(name: str, lost: int) -> None:
    assert all(line.is_kept for line in budget.figures(SUMMARY, 0, 200.0))
    more = SUMMARY | {name: SUMMARY[name] + 1}
    lines = budget.figures(more, lost, 200.0)
    assert [line.is_kept for line in lines].count(False) == 1


def samples(count: int) -> Samples:
    """At rest, north up front: any filter has something to say."""
    ones = np.ones((count, 1))
    mag = ones * [0.0, 20.0, -40.0]
    mag[::2] = np.nan
    return Samples(200.0, ones * [0.01, 0.0, 0.0], ones * [0.0, 0.1, 9.8], mag)


def test_records_are_as_the_program_has_them() -> None:
    whole = samples(2)
    fixed = filters.records(whole, is_fixed=True)
    floats = filters.records(whole, is_fixed=False)
    assert struct.unpack("<9iB", fixed[37:]) == (
        335544, 0, 0, 0, 209715, 20552090, 0, 20 << 18, -40 << 18, 1,
    )  # fmt: skip
    assert struct.unpack("<9fB", floats[:37])[6:] == (0.0, 0.0, 0.0, 0)
    assert struct.unpack("<9fB", floats[37:])[6:] == (0.0, 20.0, -40.0, 1)


def test_a_filter_is_measured_and_found_right(tmp_path: Path) -> None:
    found = {item.key: item for item in filters.filters()}["float_madgwick"]
    cost = filters.cost(found, samples(40), tmp_path)
    assert 20_000 < cost.step_mean <= cost.step_worst < 60_000
    assert 500 < cost.answer_mean < 3_000
    assert 3_000 < cost.flash < 8_000
    assert 12 < cost.ram < 100
    assert 20 < cost.stack < 400
    assert "deg of doubles" in cost.checked


def bare(source: str, folder: Path) -> Filter:
    """A program of the bench whose answers are zeros."""
    path = folder / "bare.c"
    path.write_text(source)

    def build(out: Path) -> None:
        filters.build_main(out, path)

    def nothing(given: Samples, folder: Path) -> FloatArray:
        del folder
        return np.zeros((len(given), 4))

    return Filter("bare", "bare", build, True, nothing)


def test_the_bench_itself_costs_nothing(tmp_path: Path) -> None:
    empty = bare((filters.AVR / "empty.c").read_text(), tmp_path)
    cost = filters.cost(empty, samples(5), tmp_path)
    assert (cost.cycles_mean, cost.cycles_worst) == (0.0, 0)
    assert (cost.flash, cost.ram, cost.stack) == (0, 0, 0)


KNOWN = """
#include "bench.h"

unsigned char bench_sample[BENCH_SAMPLE_SIZE];
unsigned char bench_answer[BENCH_ANSWER_SIZE];
volatile unsigned char state[50];

void bench_init(void) {
    state[0] = 0;
}

void bench_step(void) {
    if (bench_sample[36]) {  // every second one has a reading of the field
        __builtin_avr_delay_cycles(999);
    }
}

void bench_make_answer(void) {
    volatile unsigned char room[100];
    room[0] = 0;
}
"""


def test_work_is_measured_to_the_cycle_and_to_the_byte(tmp_path: Path) -> None:
    cost = filters.cost(bare(KNOWN, tmp_path), samples(10), tmp_path)
    test = 5  # LDS, TST, BREQ; the way past the work is a cycle longer
    assert cost.step_worst == 999 + test - 1
    assert cost.step_mean == (999 + test - 1 + test) / 2
    assert cost.ram == 50
    assert 102 <= cost.stack <= 106  # with the frame pointer


def test_wrong_answers_are_no_figures() -> None:
    right = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    wrong = right.copy()
    wrong[1] = [np.cos(0.02), 0.0, np.sin(0.02), 0.0]  # 2.3 deg
    item = {item.key: item for item in filters.filters()}["float_vqf"]
    fixed, floats = replace(item, is_fixed=True), item
    assert "same bits" in filters.check(fixed, right, right)
    assert "deg" in filters.check(floats, right, right)
    with pytest.raises(FilterFailed, match="1 answers differ"):
        filters.check(fixed, wrong, right)
    with pytest.raises(FilterFailed, match=r"2\.29\d deg"):
        filters.check(floats, wrong, right)
    with pytest.raises(FilterFailed, match="2 answers to 3"):
        filters.check(floats, right[:2], right)
    wrong[1] = np.nan
    with pytest.raises(FilterFailed, match="nan deg"):
        filters.check(floats, wrong, right)


def test_a_program_too_big_for_the_chip_is_told(tmp_path: Path) -> None:
    big = tmp_path / "big.c"
    big.write_text(
        (filters.AVR / "empty.c").read_text()
        + "unsigned char more[2048]; unsigned char *keep(void) { return more; }\n"
    )
    with pytest.raises(filters.DoesNotFit, match="region"):
        filters.build_main(tmp_path / "big.elf", big, options=["-Wl,-u,keep"])


def test_room_is_looked_for_in_what_the_linker_lets_pass(tmp_path: Path) -> None:
    full = tmp_path / "full.c"
    source = (filters.AVR / "empty.c").read_text()
    full.write_text(
        source + "unsigned char more[1995]; char *keep(void) { return more; }"
    )
    image = tmp_path / "full.elf"
    filters.build_main(image, full, options=["-Wl,-u,keep"])
    with pytest.raises(filters.DoesNotFit, match="2048 of RAM"):
        filters.require_room(image)


def test_images_of_the_nano_are_those_of_platformio() -> None:
    names = images.environments()
    filters_of_papers = ["complementary", "mahony", "madgwick", "dcm_pi"]
    assert names == ["nano", *(f"nano_{name}" for name in filters_of_papers)]


def test_each_board_has_limits_of_its_own() -> None:
    worst = SUMMARY | {"cycles_worst": 72_001, "flash": 40_000, "ram": 90_000}
    nano, f405 = (budget.figures(worst, 0, 200.0, name) for name in ("nano", "f405"))
    assert not all(line.is_kept for line in nano)
    assert all(line.is_kept for line in f405)
    stack = SUMMARY | {"stack_max": 8193}
    lines = budget.figures(stack, 0, 200.0, "f405")
    assert [line.name for line in lines if not line.is_kept] == ["RAM: deepest stack"]


def tallies(name: str, inside: int) -> dict[str, Any]:
    return {name: {"self": tally(0, 0, 0, 0), "inclusive": tally(inside, 90, 0, 0)}}


def test_a_filters_cost_is_over_the_samples_that_it_ran_for() -> None:
    functions = tallies("mahony_step", 5000) | tallies("mahony_orientation", 500)
    after_us = f405_load.FILTER_FROM_US
    rows = np.array([(after_us - 1,), *[(after_us + 1 + i,) for i in range(50)]],
                    [("time_us", "<u4")])  # fmt: skip
    feed = SimpleNamespace(rows=rows)
    profile = {"samples": 51, "functions": functions}
    measured: Any = SimpleNamespace(profile=profile, capture=SimpleNamespace(feed=feed))
    found = f405_load.filtered(measured, "mahony")
    assert found == f405_load.Filtered(step_mean=100.0, step_worst=90, pose_mean=10.0)
    with pytest.raises(RunFailed, match="dcm_pi"):
        f405_load.filtered(measured, "dcm_pi")


@pytest.mark.nightly
@pytest.mark.usefixtures("boards")
def test_the_f405s_image_runs_the_filter_that_it_is_told_to(
    tmp_path: Path, f405_image: Path
) -> None:
    hand = tmp_path / "hand.npz"
    sensors.generate(2.0, seed=3).save(hand)
    found = f405_load.each_filter(f405_image, hand, seed=1)
    assert list(found) == ["fuse", "complementary", "mahony", "madgwick", "dcm_pi"]
    assert all(500 < each["step_mean"] < 5000 for each in found.values())


@pytest.mark.usefixtures("boards")
def test_a_pose_for_every_sample_takes_its_share_of_the_wire(
    tmp_path: Path, f405_image: Path
) -> None:
    hand = tmp_path / "hand.npz"
    sensors.generate(4.0, seed=3).save(hand)
    found = f405_load.at_rate(f405_image, 380, hand, seed=1)
    assert found.poses_hz == pytest.approx(380.0, abs=0.2)
    assert found.late == found.lost == found.log_dropped == 0
    assert 0.3 < found.wire < 0.5


@pytest.mark.nightly
def test_a_filter_of_ours_is_built_alone_for_the_avr(tmp_path: Path) -> None:
    filters.build_house("mahony", tmp_path / "mahony.elf")
    assert (tmp_path / "mahony.elf").stat().st_size > 0
