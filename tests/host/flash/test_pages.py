# SPDX-License-Identifier: MIT
"""An image in a Nano and in a Mega, page by page: a cut after any page, pages that are
not kept, other chips.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from host.flash import stk500_board, stk500v2_board
from host.flash.boot_cable import LOOP, Cut, Mute
from host.flash.stk500_board import Stk500Board
from host.flash.stk500v2_board import Stk500v2Board
from imud.errors import FlashError
from imud.flash import mega, nano, pages, stk500, stk500v2
from imud.flash.errors import HalfWritten, WrongChip
from imud.flash.stk500 import BootWire, NoBootloader


@dataclass(frozen=True)
class Kind:
    """A board, its bootloader, and images for it."""

    made: Callable[..., Any]
    reached: Callable[[Any], Any]
    writes: Callable[..., int]
    is_page: Callable[[bytes], bool]  # whether a command writes one
    fitting: tuple[bytes, ...]
    begins_at: int
    page: int
    old: bytes  # its first word begins no jump
    new: bytes

    @property
    def image(self) -> dict[int, int]:
        return dict(enumerate(self.new))

    @property
    def pages(self) -> int:
        return -(-len(self.new) // self.page)

    def bootloader(self, board: object) -> Any:
        found = self.reached(board)
        found.sync()
        return found

    def cut(self, board: Any, count: int) -> None:
        """It is unplugged after so many pages."""
        write = board.write

        def cut(data: bytes, /) -> Any:
            if self.is_page(data) and board.writes == count:
                raise Cut
            return write(data)

        board.write = cut


NANO = Kind(
    Stk500Board,
    stk500.Stk500,
    lambda loader, *rest: nano.write(loader, nano.OPTIBOOT_AT, *rest),
    lambda data: data[0] == 0x64,
    nano.FITTING,
    nano.OPTIBOOT_AT,
    stk500_board.PAGE,
    bytes(range(1, 251)) * 100,
    bytes(reversed(range(1, 252))) * 110,
)
MEGA = Kind(
    Stk500v2Board,
    stk500v2.Stk500v2,
    mega.write,
    lambda data: data[5] == 0x13,
    mega.FITTING,
    stk500v2_board.BOOTLOADER,
    stk500v2_board.PAGE,
    bytes(range(1, 251)) * 40,
    bytes(reversed(range(1, 252))) * 44,
)
BOTH = pytest.mark.parametrize("kind", [NANO, MEGA], ids=["nano", "mega"])


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """These bootloaders are there without blinking first."""
    monkeypatch.setattr(stk500, "BEGIN_S", 0.0)
    monkeypatch.setattr(stk500, "QUIET_S", 0.0)
    monkeypatch.setattr(stk500v2, "BEGIN_S", 0.0)


@pytest.mark.parametrize(
    ("kind", "count"),
    [(kind, n) for kind in (NANO, MEGA) for n in range(kind.pages + 1)],
)
def test_a_cut_after_any_page_leaves_what_runs_or_a_loop(
    kind: Kind, count: int
) -> None:
    board = kind.made(kind.old)
    kind.cut(board, count)
    with pytest.raises(Cut):
        kind.writes(kind.bootloader(board), kind.image)
    assert board.flash.startswith(kind.old if count == 0 else LOOP)
    # Whatever it was, the next try ends well.
    again = kind.made(bytes(board.flash))
    assert kind.writes(kind.bootloader(again), kind.image) == kind.pages
    assert again.flash.startswith(kind.new)


def test_three_exclamation_marks_never_reach_a_mega() -> None:
    board = MEGA.made(MEGA.old)
    image = dict(enumerate(MEGA.new))
    split = image | dict.fromkeys(range(2 * MEGA.page - 2, 2 * MEGA.page + 1), 0x21)
    assert MEGA.writes(MEGA.bootloader(board), split) == MEGA.pages
    writes = board.writes
    within = image | dict.fromkeys(range(0x10A, 0x10D), 0x21)
    with pytest.raises(FlashError, match="has !!! at 0x10a, at which older"):
        MEGA.writes(MEGA.bootloader(board), within)
    assert board.writes == writes
    sent: list[bytes] = []  # nor by the last two of a page and the checksum
    loader = stk500v2.Stk500v2(SimpleNamespace(write=sent.append))  # type: ignore[arg-type]
    for _ in range(256):
        loader._send(b"\x13!!")
    assert not any(stk500v2.MONITOR in message for message in sent)


@BOTH
def test_a_page_that_is_not_kept_ends_it_with_nothing_that_runs(kind: Kind) -> None:
    board = kind.made(kind.old)

    def stop_keeping(done: int, _: int) -> None:
        board.keeps = done < 10

    place = f"the page at 0x{9 * kind.page:04x} reads back wrong"
    with pytest.raises(HalfWritten, match=place):
        kind.writes(kind.bootloader(board), kind.image, stop_keeping)
    assert board.flash.startswith(LOOP)


@pytest.mark.parametrize(
    ("kind", "signature", "name"),
    [
        *((NANO, each, "") for each in ("1e9587", "1e9801", "1e930a", "ffffff")),
        (MEGA, "1e9703", "ATmega1280"),
        (MEGA, "1e950f", "ATmega328P"),
        (MEGA, "ffffff", "an unknown chip"),
    ],
)
def test_another_chip_is_told_and_left_alone(
    kind: Kind, signature: str, name: str
) -> None:
    board = kind.made(kind.old, signature=bytes.fromhex(signature))
    wanted = pages.KNOWN_CHIPS[kind.fitting[0]]
    with pytest.raises(WrongChip, match=f"{name}.*the image is for an {wanted}"):
        pages.check_chip(kind.bootloader(board), kind.fitting)
    assert board.writes == 0


@BOTH
def test_an_image_must_end_below_the_bootloader_and_have_bytes(kind: Kind) -> None:
    board = kind.made(kind.old)
    loader = kind.bootloader(board)
    with pytest.raises(FlashError, match=f"the bootloader starts at {kind.begins_at}"):
        kind.writes(loader, {0: 1, kind.begins_at: 2})
    with pytest.raises(FlashError, match="no bytes"):
        kind.writes(loader, {})
    assert board.writes == 0


# The Nano's bootloaders.


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


# The Mega's.


@pytest.mark.parametrize("says", [0x00, 0xC0])
def test_older_and_newer_bootloaders_take_an_image_twice(says: int) -> None:
    board = Stk500v2Board(MEGA.old)
    board.erase_says = says
    bootloader = MEGA.bootloader(board)
    for image in (MEGA.image, dict(enumerate(MEGA.old)), MEGA.image):
        mega.write(bootloader, image)
        assert board.flash.startswith(bytes(image.values()))
    bootloader.leave()
    assert board.has_left


class SilentBoard(Stk500v2Board):
    """It says nothing more once it was told so often to begin at the first page."""

    def __init__(self, rewinds: int) -> None:
        super().__init__(MEGA.old)
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
        mega.write(MEGA.bootloader(board), MEGA.image)
    assert not isinstance(told.value, HalfWritten)
    assert board.flash.startswith(MEGA.old)
    board = SilentBoard(2)
    with pytest.raises(HalfWritten, match="for the first page"):
        mega.write(MEGA.bootloader(board), MEGA.image)
    assert board.flash.startswith(LOOP)


def test_a_silent_mega_is_reset_again_and_then_told(
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
    board = Stk500v2Board(MEGA.old)
    bootloader = MEGA.bootloader(board)
    # The firmware's last words, with beginnings of messages in them; an answer to an
    # earlier try; one of the right number whose sum is wrong.
    number = bootloader._number + 1
    board._said = bytes((0x1B, number, 0x1B, 0, 0x1B, number, 0, 3)) + b"\x0e\x14"
    board.say(number - 1, b"\x06\0")
    board.say(number, b"\x06\0")
    board._said = board._said[:-1] + b"\x55"
    assert bootloader.read(0x10, 4) == MEGA.old[0x10:0x14]


def test_an_answer_of_another_length_or_command_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stk500v2, "ANSWER_S", 0.01)
    board = Stk500v2Board(MEGA.old)
    bootloader = MEGA.bootloader(board)
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
    board = GoneAtTheEnd(MEGA.old)
    monkeypatch.setattr(mega.serial_port, "reset", lambda *_: nullcontext(board))
    assert mega.flash("port", MEGA.image, lambda _done, _all: None) == MEGA.pages
    assert board.flash[: len(MEGA.new)] == MEGA.new
    assert not board.has_left
