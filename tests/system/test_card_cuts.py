# SPDX-License-Identifier: MIT
"""The log on the card after a power cut."""

from __future__ import annotations

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from length import choose
from system.card_log import CLICK, LOST_US, STREAMS_US, Recorded, prepare, recordings
from system.virtual import BOARDS, Stub, assert_nothing_is_lost, run, write_hand

CUTS, IN_A_TEST = choose(everyday=(2, 2), long=(200, 5))
RUN_MESSAGES = 8 * 496 // 39  # in the blocks that the card is given at once


@dataclass(frozen=True)
class Undisturbed:
    """The run that the cut ones are the beginning of."""

    stub: Stub
    template: Path  # the card before
    options: tuple[object, ...]
    reference: Recorded


@pytest.fixture(scope="module")
def undisturbed(
    boards: dict[str, tuple[Path, Path]], tmp_path_factory: pytest.TempPathFactory
) -> Undisturbed:
    stub = Stub(BOARDS["f405"], *boards["f405"], tmp_path_factory.mktemp("cuts"))
    template = prepare(stub.folder / "template")
    card = stub.folder / "card"
    shutil.copy(template, card)
    options = ("--motion", write_hand(stub.folder / "hand", 8), *CLICK)
    assert_nothing_is_lost(run(stub, 7, *options, "--card", card))
    (reference,) = recordings(card)
    return Undisturbed(stub, template, options, reference)


def lost_us(whole: Undisturbed, folder: Path, at_us: int) -> int:
    """How much older than the cut the last sample is that it has left on the card."""
    folder.mkdir()
    card = folder / "card"
    subprocess.run(["cp", "--sparse=always", whole.template, card], check=True)
    cut = {"kind": "power_cut", "at_us": at_us}
    stub = replace(whole.stub, folder=folder)
    done = run(stub, 7, *whole.options, "--card", card, faults=[cut])
    assert done.summary["power_cut"]
    (recorded,) = recordings(card)
    assert not recorded.is_ended
    card.unlink()
    # Whatever is there is what would have been, byte by byte. Of the run that the card
    # was at, blocks may be there before which others are missing: those don't count.
    reference = whole.reference.contents
    numbers = [message.sequence for message in recorded.messages]
    assert recorded.contents == [reference[number] for number in numbers]
    whole_until = next(
        (n for n, number in enumerate(numbers) if n != number), len(numbers)
    )
    assert len(numbers) - whole_until < RUN_MESSAGES
    kept = [m for m in recorded.messages[:whole_until] if m.name == "raw"]
    return at_us - kept[-1].time_us


@pytest.mark.long
@pytest.mark.parametrize("part", range(CUTS // IN_A_TEST))
def test_a_cut_at_any_moment_loses_half_a_second_at_most(
    undisturbed: Undisturbed, tmp_path: Path, part: int
) -> None:
    moments = np.random.default_rng(4).integers(STREAMS_US + LOST_US, 6_500_000, CUTS)
    with ThreadPoolExecutor(2) as pool:
        losses = pool.map(
            lambda number: lost_us(
                undisturbed, tmp_path / str(number), int(moments[number])
            ),
            range(IN_A_TEST * part, IN_A_TEST * (part + 1)),
        )
        assert all(0 <= lost <= LOST_US for lost in losses)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("stub", ["f405"], indirect=True)
@pytest.mark.parametrize("after_us", [0, 120, 400])
def test_a_cut_in_the_midst_of_a_block_is_written_over_by_the_next_recording(
    stub: Stub, after_us: int
) -> None:
    card = prepare(stub.folder / "card")
    cut = {"kind": "power_cut", "card_write": 60, "after_us": after_us}
    assert run(stub, 9, "--card", card, *CLICK, faults=[cut]).summary["power_cut"]
    (first,) = recordings(card)
    run(stub, 6, "--card", card, *CLICK, "--press", "4000000:4100000")
    found = recordings(card)
    assert [r.number for r in found] == [1, 2]
    assert found[0].contents == first.contents
    # Blocks of the run that the card was at may be there, and others before them not.
    assert found[0].bad < 8
    assert found[1].bad == 0
    assert found[1].is_ended
