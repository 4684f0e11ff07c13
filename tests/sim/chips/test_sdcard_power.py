# SPDX-License-Identifier: MIT
"""The contents of the model of the SD card after a power cut."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from length import choose
from sim.chips.sdcard_desk import ACCEPTED, BLOCK, SLOW, Card, kind_of, lib, pattern

pytestmark = pytest.mark.long

SEEDS = range(0, 200, choose(everyday=7, long=1))


def test_a_block_that_power_leaves_amid_is_old_new_or_torn(
    tmp_path: Path,
) -> None:
    seen = {"old": 0, "new": 0, "torn": 0}
    for seed in SEEDS:
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 10 * BLOCK)
        assert card.write(2, pattern(2)) == ACCEPTED
        card.ready()
        assert card.write(3, pattern(3)) == ACCEPTED
        card.send(1)
        card.now += seed * 1400  # busy lasts at least 0.3 ms
        card.cut()
        assert card.stored(2) == pattern(2)  # it was no longer busy with this block
        seen[kind_of(card.stored(3), b"\x55" * BLOCK, pattern(3))] += 1
        assert card.stored(0, 2) == b"\x55" * 2 * BLOCK
        assert card.stored(4, 6) == b"\x55" * 6 * BLOCK
        assert card.send(8) == b"\xff" * 8
        assert card.complaint() is None
    assert min(seen.values()) >= 0.1 * len(SEEDS), seen


def test_a_run_that_power_leaves_amid_loses_at_most_its_last_16(
    tmp_path: Path,
) -> None:
    torn, shapes = 0, set()
    for seed in SEEDS:
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 60 * BLOCK)
        count = 1 + seed % 40
        card.r1(25, 5 * BLOCK)
        for number in range(count):
            assert card.put(pattern(number), 0xFC) == ACCEPTED
            card.ready()
        # In every other run the cut comes during the next block, not yet acknowledged.
        card.send(b"\xff\xfc" + pattern(99)[: seed % 2 * 300])
        card.cut()
        kinds = [
            kind_of(card.stored(5 + i), b"\x55" * BLOCK, pattern(i))
            for i in range(count)
        ]
        assert set(kinds[: max(0, count - 16)]) <= {"new"}
        assert kinds.count("torn") <= 1
        torn += kinds.count("torn")
        shapes.add(tuple(key for key, _ in itertools.groupby(kinds)))
        assert card.stored(5 + count) == b"\x55" * BLOCK
        assert card.complaint() is None
    assert torn > 0.25 * len(SEEDS)
    assert ("new", "torn", "old") in shapes
    assert any(len(shape) > 4 for shape in shapes)  # blocks written out of order


def test_a_stopped_run_survives_any_cut(tmp_path: Path) -> None:
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        contents = [pattern(seed + i) for i in range(20)]
        card.write_run(0, *contents)
        card.cut()
        assert card.stored(0, 20) == b"".join(contents)


def test_a_cut_leaves_an_erasure_undone_from_somewhere(tmp_path: Path) -> None:
    left = set()
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 60 * BLOCK)
        card.r1(32, 10 * BLOCK)
        card.r1(33, 29 * BLOCK)
        card.r1(38)
        card.send(1)
        card.cut()
        whole = card.stored(0, 60)
        zeros = whole.count(0) // BLOCK
        assert whole[10 * BLOCK :].startswith(bytes(zeros * BLOCK))
        left.add(20 - zeros)
    assert len(left) > 8
    assert max(left) <= 20


def test_a_supply_that_dips_is_power_up(card: Card) -> None:
    card.write(1, pattern(1))
    card.ready()
    lib.sdcard_chip_power_cycle(card.chip, card.now)
    card.select(on=False)
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(1) == pattern(1)


def test_a_run_s_end_lets_it_finish(card: Card) -> None:
    card.r1(25, card.address(0))
    card.put(pattern(0), 0xFC)
    lib.sdcard_chip_finish(card.chip, card.now)
    assert card.stored(0) == pattern(0)


def test_two_cards_of_a_seed_do_the_same_and_others_do_not(tmp_path: Path) -> None:
    def story(seed: int) -> tuple[bytes, int]:
        card = Card(tmp_path, seed=seed).identify()
        answers = bytearray()
        for number in range(20):
            card.r1(25, 0)
            for _ in range(3):
                answers.append(card.put(pattern(number), 0xFC))
                card.ready()
            card.stop()
            answers += card.read(0)
        return bytes(answers), card.now

    assert story(1) == story(1)
    assert story(1)[1] != story(2)[1]
