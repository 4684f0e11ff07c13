# SPDX-License-Identifier: MIT
"""An image in a Nano: a cut after any page, pages that are not kept, other chips."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

import pytest

from host.flash.boot_cable import LOOP, Cut, Mute
from host.flash.stk500_board import PAGE, Stk500Board
from imud.errors import FlashError
from imud.flash import nano, stk500
from imud.flash.errors import HalfWritten, WrongChip
from imud.flash.stk500 import BootWire, NoBootloader, Stk500

OLD = bytes(range(1, 251)) * 100  # its first word begins no jump
NEW = bytes(reversed(range(1, 252))) * 110
IMAGE = dict(enumerate(NEW))
PAGES = -(-len(NEW) // PAGE)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """This bootloader is there without blinking first."""
    monkeypatch.setattr(stk500, "BEGIN_S", 0.0)
    monkeypatch.setattr(stk500, "QUIET_S", 0.0)


class CutBoard(Stk500Board):
    """It is unplugged after so many pages."""

    def __init__(self, pages: int) -> None:
        super().__init__(OLD)
        self._pages = pages

    def write(self, data: bytes, /) -> int:
        if data[0] == 0x64 and self.writes == self._pages:
            raise Cut
        return super().write(data)


def reached(board: Stk500Board) -> Stk500:
    found = Stk500(board)
    found.sync()
    return found


@pytest.mark.parametrize(
    ("major", "begins_at"), [(1, 0x7800), (2, 0x7800), (4, 0x7E00)]
)
def test_a_bootloader_tells_by_its_version_where_it_begins(
    major: int, begins_at: int
) -> None:
    board = Stk500Board(major=major)
    with nano.reached(lambda _: nullcontext(board)) as (_, found):
        assert found == begins_at


def test_the_other_baud_rate_is_tried_and_each_of_them_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stk500, "SYNC_S", 0.01)
    tried: list[int] = []

    def opened(baud: int) -> AbstractContextManager[BootWire]:
        tried.append(baud)
        return nullcontext(Stk500Board() if len(tried) == answers_at else Mute())

    answers_at = 4
    with nano.reached(opened):
        assert tried == [115_200, 57_600, 115_200, 57_600]
    answers_at = 0
    with (
        pytest.raises(NoBootloader, match="at 115200 or 57600 baud"),
        nano.reached(opened),
    ):
        pass


@pytest.mark.parametrize("pages", range(PAGES + 1))
def test_a_cut_after_any_page_leaves_what_runs_or_a_loop(pages: int) -> None:
    board = CutBoard(pages)
    with pytest.raises(Cut):
        nano.write(reached(board), nano.OPTIBOOT_AT, IMAGE)
    if pages == 0:
        assert board.flash.startswith(OLD)
    else:
        assert board.flash.startswith(LOOP)
    # Whatever it was, the next try ends well.
    again = Stk500Board(bytes(board.flash))
    assert nano.write(reached(again), nano.OPTIBOOT_AT, IMAGE) == PAGES
    assert again.flash.startswith(NEW)


def test_a_page_that_is_not_kept_ends_it_with_nothing_that_runs() -> None:
    board = Stk500Board(OLD)
    bootloader = reached(board)

    def stop_keeping(done: int, _: int) -> None:
        board.keeps = done < 10

    with pytest.raises(HalfWritten, match=r"the page at 0x0480 reads back wrong"):
        nano.write(bootloader, nano.OPTIBOOT_AT, IMAGE, stop_keeping)
    assert board.flash.startswith(LOOP)


@pytest.mark.parametrize("signature", ["1e9587", "1e9801", "1e930a", "ffffff"])
def test_another_chip_is_told_and_left_alone(signature: str) -> None:
    board = Stk500Board(OLD, signature=bytes.fromhex(signature))
    with pytest.raises(WrongChip, match="the image is for an ATmega328P"):
        nano.check_chip(reached(board))
    assert board.writes == 0


def test_an_image_must_end_below_the_bootloader_and_have_bytes() -> None:
    board = Stk500Board(OLD)
    with pytest.raises(FlashError, match="the bootloader starts at 30720"):
        nano.write(reached(board), nano.ATMEGABOOT_AT, {0: 1, nano.ATMEGABOOT_AT: 2})
    with pytest.raises(FlashError, match="no bytes"):
        nano.write(reached(board), nano.OPTIBOOT_AT, {})
    assert board.writes == 0
