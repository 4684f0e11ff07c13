# SPDX-License-Identifier: MIT
"""A change of params by the images as flashed is one transaction: whatever happens on
the way, the old params hold or all new ones do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fakes.records import calibration_record, record
from length import choose
from system.params_orders import (
    APPLY_US,
    WORD_US,
    answers,
    in_force,
    upload,
    words,
)
from system.virtual import BOARDS, Run, Stub, run

pytestmark = pytest.mark.sampled(4)

ACC, GYR, OPTIONS, FOREIGN = 1, 2, 5, 99
MATRIX = [16500, 9, -7, 0, 16200, 3, 0, 0, 16384]
OLD = calibration_record(GYR, [70_000, -40_000, 9000], MATRIX)
NEW = (
    calibration_record(ACC, [300_000, -250_000, 9000], MATRIX)
    + record(OPTIONS, bytes((1, 2)))
    + record(FOREIGN, b"other")
)
CASES = choose(everyday=2, long=None)  # cuts, and resets; None: all
PARTS = choose(everyday=1, long=12)  # tests that share them

STEP_US = 5010  # no multiple of the firmware's steps of 5 ms
WRITTEN_US = 5000  # a byte is in memory, on either board
BOOTED_US = 400_000  # the boot has written what it has to


@dataclass(frozen=True)
class Prepared:
    """A board whose memory holds the old params."""

    stub: Stub
    memory: bytes

    def run(
        self, seconds: float, *options: object, faults: Sequence[dict[str, object]] = ()
    ) -> Run:
        """A run on that memory, and the memory after it in `left`."""
        path = self.path
        path.write_bytes(self.memory)
        return run(self.stub, seconds, "--eeprom", path, *options, faults=faults)

    def again(self, seconds: float, *options: object) -> Run:
        """A run on what the one before has left."""
        return run(self.stub, seconds, "--eeprom", self.path, *options)

    @property
    def path(self) -> Path:
        return self.stub.folder / "memory"


@pytest.fixture(scope="module", params=BOARDS)
def kept(
    request: pytest.FixtureRequest,
    boards: dict[str, tuple[Path, Path]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Prepared:
    name = request.param
    stub = Stub(BOARDS[name], *boards[name], tmp_path_factory.mktemp("params"))
    done = run(stub, seconds_of(OLD), "--eeprom", stub.folder / "memory", *loading(OLD))
    assert in_force(done) == [b"", OLD]
    return Prepared(stub, (stub.folder / "memory").read_bytes())


@pytest.fixture
def board(kept: Prepared, tmp_path: Path) -> Prepared:
    return replace(kept, stub=replace(kept.stub, folder=tmp_path))


def loading(records: bytes) -> list[str]:
    return upload(records, BOOTED_US)


def seconds_of(records: bytes) -> float:
    """A run that begins with `loading`, and in which they come into force."""
    return (BOOTED_US + len(words(records)) * WORD_US + 2 * APPLY_US) / 1e6


def part_of(count: int, part: int) -> list[int]:
    """One test's part of `count` cases, in a seeded order."""
    cases = np.random.default_rng(13).permutation(count)[:CASES]
    return [int(case) for case in cases[part::PARTS]]


# Power and resets.


def assert_all_is_as_ever(board: Prepared, allowed: Sequence[bytes]) -> None:
    """After a start one of these is in force, and others can be loaded."""
    after = board.again(seconds_of(NEW), *loading(NEW))
    first, last = in_force(after)
    assert first in allowed
    assert last == NEW
    assert answers(after)[-1][0] == "ok"
    told = {event for event, _ in after.events}
    assert not told & {"params_lost", "settings_restored", "settings_failed"}


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_a_power_cut_at_any_byte_leaves_the_old_params_or_all_new_ones(
    board: Prepared, part: int
) -> None:
    begin, switch = (
        board.run(seconds_of(NEW), *options).summary["eeprom_writes"]
        for options in ((), loading(NEW))
    )
    assert switch - begin > len(NEW)
    midst = board.stub.board.write_us
    cuts = [
        (begin + 1 + number, midst, (OLD,))
        for number in part_of(switch - 1 - begin, part)
    ]
    cuts += [(switch, midst, (OLD, NEW)), (switch, WRITTEN_US, (NEW,))]
    for write, after_us, allowed in cuts:
        cut = {"kind": "power_cut", "write": write, "after_us": after_us}
        done = board.run(seconds_of(NEW), *loading(NEW), faults=[cut])
        assert done.summary["power_cut"]
        assert_all_is_as_ever(board, allowed)


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_a_reset_at_any_step_leaves_the_old_params_or_all_new_ones(
    board: Prepared, part: int
) -> None:
    seconds = seconds_of(NEW)
    steps = int((seconds * 1e6 - BOOTED_US) / STEP_US)
    for step in part_of(steps, part):
        fault = {"kind": "reset", "at_us": BOOTED_US + step * STEP_US}
        # Its last frame may be torn, and take the first hello after it along.
        done = board.run(seconds + 0.6, *loading(NEW), faults=[fault])
        assert done.summary["resets"] == 1
        assert done.summary["firmware_complaint"] is None
        _, held, last = in_force(done)
        assert held in (OLD, NEW)
        assert last in (held, NEW)
        assert_all_is_as_ever(board, (last,))
