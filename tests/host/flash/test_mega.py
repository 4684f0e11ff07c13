# SPDX-License-Identifier: MIT
"""An image in a Mega: a cut after any page, pages that are not kept, other chips, and
what comes in place of an answer.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext

import pytest

from host.flash.boot_cable import LOOP, Cut, Mute
from host.flash.stk500v2_board import PAGE, Stk500v2Board
from imud.errors import FlashError
from imud.flash import mega, pages, stk500v2
from imud.flash.errors import HalfWritten, WrongChip
from imud.flash.stk500 import BootWire, NoBootloader
from imud.flash.stk500v2 import Stk500v2

OLD = bytes(range(1, 251)) * 40  # its first word begins no jump
NEW = bytes(reversed(range(1, 252))) * 44
IMAGE = dict(enumerate(NEW))
PAGES = -(-len(NEW) // PAGE)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing was said before the reset."""
    monkeypatch.setattr(stk500v2, "BEGIN_S", 0.0)


class CutBoard(Stk500v2Board):
    """It is unplugged after so many pages."""

    def __init__(self, pages: int) -> None:
        super().__init__(OLD)
        self._pages = pages

    def write(self, data: bytes, /) -> int:
        if data[5] == 0x13 and self.writes == self._pages:
            raise Cut
        return super().write(data)


def reached(board: BootWire) -> Stk500v2:
    found = Stk500v2(board)
    found.sync()
    return found


@pytest.mark.parametrize("count", range(PAGES + 1))
def test_a_cut_after_any_page_leaves_what_runs_or_a_loop(count: int) -> None:
    board = CutBoard(count)
    with pytest.raises(Cut):
        mega.write(reached(board), IMAGE)
    if count == 0:
        assert board.flash.startswith(OLD)
    else:
        assert board.flash.startswith(LOOP)
    # Whatever it was, the next try ends well.
    again = Stk500v2Board(bytes(board.flash))
    assert mega.write(reached(again), IMAGE) == PAGES
    assert again.flash.startswith(NEW)


@pytest.mark.parametrize("says", [0x00, 0xC0])
def test_older_and_newer_bootloaders_take_an_image_twice(says: int) -> None:
    board = Stk500v2Board(OLD)
    board.erase_says = says
    bootloader = reached(board)
    for image in (IMAGE, dict(enumerate(OLD)), IMAGE):
        mega.write(bootloader, image)
        assert board.flash.startswith(bytes(image.values()))
    bootloader.leave()
    assert board.has_left


def test_a_page_that_is_not_kept_ends_it_with_nothing_that_runs() -> None:
    board = Stk500v2Board(OLD)
    bootloader = reached(board)

    def stop_keeping(done: int, _: int) -> None:
        board.keeps = done < 10

    with pytest.raises(HalfWritten, match=r"the page at 0x0900 reads back wrong"):
        mega.write(bootloader, IMAGE, stop_keeping)
    assert board.flash.startswith(LOOP)


class SilentBoard(Stk500v2Board):
    """It says nothing more once it was told so often to begin at the first page."""

    def __init__(self, rewinds: int) -> None:
        super().__init__(OLD)
        self._left = rewinds

    def write(self, data: bytes, /) -> int:
        self._left -= data[5] == 0x12
        return super().write(data) if self._left > 0 else len(data)


def test_a_board_is_half_written_only_once_a_write_began(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stk500v2, "ANSWER_S", 0.1)
    board = SilentBoard(1)
    with pytest.raises(FlashError, match="for the first page") as told:
        mega.write(reached(board), IMAGE)
    assert not isinstance(told.value, HalfWritten)
    assert board.flash.startswith(OLD)
    board = SilentBoard(2)
    with pytest.raises(HalfWritten, match="for the first page"):
        mega.write(reached(board), IMAGE)
    assert board.flash.startswith(LOOP)


@pytest.mark.parametrize(
    ("signature", "name"),
    [("1e9703", "ATmega1280"), ("1e950f", "ATmega328P"), ("ffffff", "an unknown chip")],
)
def test_another_chip_is_told_and_left_alone(signature: str, name: str) -> None:
    board = Stk500v2Board(OLD, signature=bytes.fromhex(signature))
    with pytest.raises(WrongChip, match=f"{name}.*the image is for an ATmega2560"):
        pages.check_chip(reached(board), mega.FITTING)
    assert board.writes == 0


def test_an_image_must_end_below_the_bootloader_and_have_bytes() -> None:
    board = Stk500v2Board(OLD)
    with pytest.raises(FlashError, match="the bootloader starts at 253952"):
        mega.write(reached(board), {0: 1, 0x3E000: 2})
    with pytest.raises(FlashError, match="no bytes"):
        mega.write(reached(board), {})
    assert board.writes == 0


def test_a_silent_board_is_reset_again_and_then_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stk500v2, "SYNC_S", 0.01)
    resets = 0

    def opened() -> AbstractContextManager[BootWire]:
        nonlocal resets
        resets += 1
        return nullcontext(Stk500v2Board() if resets == answers_at else Mute())

    answers_at = 3
    with mega.reached(opened):
        assert resets == 3
    answers_at = 0
    with (
        pytest.raises(NoBootloader, match="at 115200 baud; is it an Arduino Mega"),
        mega.reached(opened),
    ):
        pass


def test_what_comes_before_an_answer_is_passed_over() -> None:
    board = Stk500v2Board(OLD)
    bootloader = reached(board)
    # The firmware's last words, with beginnings of messages in them; an answer to an
    # earlier try; one of the right number whose sum is wrong.
    number = bootloader._number + 1
    board._said = bytes((0x1B, number, 0x1B, 0, 0x1B, number, 0, 3)) + b"\x0e\x14"
    board.say(number - 1, b"\x06\0")
    board.say(number, b"\x06\0")
    board._said = board._said[:-1] + b"\x55"
    assert bootloader.read(0x10, 4) == OLD[0x10:0x14]


def test_an_answer_of_another_length_or_command_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stk500v2, "ANSWER_S", 0.01)
    board = Stk500v2Board(OLD)
    bootloader = reached(board)
    for answer in (b"\x06", b"\x06\xc0", b"\x06\0\0", b"\x14\0", b""):
        board._answer = lambda _, said=answer: said  # type: ignore[assignment,misc]
        with pytest.raises(FlashError, match="did not answer for the address"):
            bootloader.read(0, 2)


class GoneAtTheEnd(Stk500v2Board):
    """It is unplugged once the image is complete."""

    def write(self, data: bytes, /) -> int:
        return len(data) if data[5] == 0x11 else super().write(data)


def test_a_board_that_is_silent_at_the_end_has_its_image(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board = GoneAtTheEnd(OLD)
    monkeypatch.setattr(mega.serial_port, "reset", lambda *_: nullcontext(board))
    assert mega.flash("port", IMAGE, lambda _done, _all: None) == PAGES
    assert board.flash[: len(NEW)] == NEW
    assert not board.has_left
