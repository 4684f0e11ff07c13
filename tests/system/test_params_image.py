# SPDX-License-Identifier: MIT
"""A change of params by the images as flashed is one transaction: whatever happens on
the way, the old params hold or all new ones do, and the stream continues.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fakes.records import calibration_record, record
from imud import _core
from imud.stages.twin_outcomes import TwinStarted, TwinState
from imud.wire import schema
from imud.wire.frame import FrameDecoder
from length import choose
from system.params_orders import (
    APPLY_US,
    WORD_US,
    answers,
    apply,
    frame,
    in_force,
    timed,
    upload,
    words,
)
from system.virtual import BOARDS, Run, Stub, assert_nothing_is_lost, run
from twin_bench import run_twin

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
STREAMS_US = 1_400_000
STREAM = ("--press", "200000:300000")


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


# Changes on the wire, while it streams.


def staging(records: bytes, first: int = 0) -> list[str]:
    """The frames that stage records, with tokens from there on."""
    return [frame(order, first + n) for n, order in enumerate(words(records))]


def asking(records: bytes, first: int = 60) -> list[str]:
    """The two that ask for them: the second one is told how it went."""
    return [frame(apply(records), first + n) for n in range(2)]


def streaming(board: Prepared, staged: Sequence[str], *asked: str) -> Run:
    """A run that streams all, and takes these frames meanwhile."""
    ask_us = STREAMS_US + len(staged) * WORD_US
    end_us = ask_us + len(asked) * APPLY_US
    options = [*timed(staged, STREAMS_US), *timed(asked, ask_us, APPLY_US)]
    seconds = end_us / 1e6 + 0.3
    return board.run(seconds, *STREAM, *board.stub.raw_too, *options)


@dataclass(frozen=True)
class Bad:
    """What a host sends that is no good change, and why, as the probe tells it."""

    name: str
    staged: Sequence[str]
    result: str = "damaged"
    records: bytes = NEW
    value: tuple[int, int] | None = None

    def __str__(self) -> str:
        return self.name


def refused(name: str, records: bytes, tag: int, fault: int) -> Bad:
    return Bad(name, staging(records), "refused", records, (tag, fault))


def struck(hexed: str, at: int) -> str:
    """A frame with another byte at some place between the zeros at its ends."""
    data = bytearray.fromhex(hexed)
    data[1 + at % (len(data) - 2)] ^= 0x21
    return data.hex()


def of_other_schema(hexed: str) -> str:
    (content,) = FrameDecoder().feed(bytes.fromhex(hexed))
    return (b"\0" + _core.encode_frame(schema.SEED ^ 0x1234, content)).hex()


WORDS = staging(NEW)
WRONG = frame(("params_write", 32, 7), 61)
TOO_STEEP = calibration_record(ACC, [0, 0, 0], [27853, *[0] * 8])
BAD = [
    Bad("a part is missing", WORDS[:7] + WORDS[8:]),
    Bad("a part is another", [*WORDS[:8], WRONG, *WORDS[9:]]),
    Bad("a part is hit by noise", [struck(each, n) for n, each in enumerate(WORDS)]),
    Bad("older schema", list(map(of_other_schema, WORDS))),
    refused("out of range", TOO_STEEP, ACC, 2),
    refused("no such option", record(OPTIONS, b"\3\0"), OPTIONS, 2),
    refused("twice in the list", record(OPTIONS, b"\0\0") * 2, OPTIONS, 3),
    refused("too short", record(GYR, OLD[2:31]), GYR, 1),
]


@pytest.mark.parametrize("bad", BAD, ids=str)
def test_a_bad_change_is_told_why_and_nothing_else_notices(
    board: Prepared, bad: Bad
) -> None:
    done = streaming(board, bad.staged, *asking(bad.records))
    assert in_force(done) == [OLD, OLD]
    given = apply(bad.records)[1:]
    assert answers(done) == [("busy", given), (bad.result, bad.value or given)]
    assert {"params_changed", "restarted"}.isdisjoint(e for e, _ in done.events)
    assert_nothing_is_lost(done)
    # Each pose is that of its samples and the old params, without a break.
    twin, outcomes = run_twin(done.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(done.named("pose")) > 50


def changes(done: Run) -> int:
    return [event for event, _ in done.events].count("params_changed")


def test_a_change_that_is_sent_twice_is_carried_out_once(board: Prepared) -> None:
    doubled = [each + each for each in [*WORDS, *asking(NEW)]]
    again = [*staging(NEW, 70), *asking(NEW, 90)]
    done = streaming(board, doubled[:-2], *doubled[-2:], *again)
    assert in_force(done) == [OLD, NEW]
    results = [result for result, _ in answers(done)]
    assert results == ["busy", "busy", "ok", "ok", "ok", "ok"]
    assert changes(done) == 1
    assert_nothing_is_lost(done)


def test_of_two_hosts_at_once_one_is_told_of_damage_and_the_other_has_its_params(
    board: Prepared,
) -> None:
    other = NEW[:20] + bytes([NEW[20] ^ 1]) + NEW[21:]
    both = zip(WORDS, staging(other, 30), strict=True)
    staged = [each for pair in both for each in pair]
    done = streaming(board, staged, *asking(NEW), *asking(other, 70))
    assert [result for result, _ in answers(done)] == ["busy", "damaged", "busy", "ok"]
    assert in_force(done) == [OLD, other]
    assert changes(done) == 1
    assert_nothing_is_lost(done)


def test_records_of_older_and_later_firmware_are_kept_byte_by_byte(
    board: Prepared,
) -> None:
    older, later = record(ACC, NEW[2:32]), record(OPTIONS, b"\1\2later")
    records = older + later + record(FOREIGN, b"other")
    done = streaming(board, staging(records), *asking(records))
    assert in_force(done) == [OLD, records]
    assert in_force(board.again(0.5)) == [records, records]
    assert_nothing_is_lost(done)
