# SPDX-License-Identifier: MIT
"""An SD card in SPI mode, small and quick: what the tests of the card's driver and of
the log talk to, through fake_spi.py.

Section numbers are the Physical Layer Simplified Specification's, version 6.00.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

BLOCK = 512
ZEROS = bytes(BLOCK)

ACCEPTED, BAD_CRC, WRITE_ERROR = 0xE5, 0xEB, 0xED  # upper bits may be anything

DATA_COMMANDS = {9, 17}


def crc7(data: bytes) -> int:
    """The check of a command, 4.5."""
    crc = 0
    for byte in data:
        for bit in range(8):
            crc = (crc << 1) ^ (0x89 if ((crc >> 6) ^ (byte >> (7 - bit))) & 1 else 0)
            crc &= 0x7F
    return crc


def _crc16_table() -> list[int]:
    table = []
    for top in range(256):
        crc = top << 8
        for _ in range(8):
            crc = ((crc << 1) ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
        table.append(crc)
    return table


_CRC16 = _crc16_table()


def crc16(data: bytes) -> int:
    """The check of a block, 4.5."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ _CRC16[crc >> 8 ^ byte]
    return crc


class FakeCard:
    """The card in the socket. Times are microseconds."""

    def __init__(
        self, blocks: int = 1 << 20, *, is_sdhc: bool = True, version: int = 2
    ) -> None:
        self.size = blocks
        self.content: dict[int, bytes] = {}
        self.is_sdhc = is_sdhc
        self.version = version
        self.ocr = 0x80FF8000 | (0x40000000 if is_sdhc else 0)
        self.csd = csd2(blocks) if is_sdhc else csd1(blocks)
        self.volts = 0x01  # CMD8: 2.7 to 3.6 V
        self.starting = 3  # times that ACMD41 says not yet
        self.pause = 1  # bytes before an answer, 1 to 8
        self.read_us = 300.0
        self.busy_us: Callable[[int], float] = lambda _: 100.0  # of the block's number
        self.stop_us = 1500.0
        self.now_us = 0.0  # of the last exchange
        self.random = random.Random(1)  # noqa: S311, no secret
        self.is_in = True
        # What goes wrong.
        self.refuse: Callable[[int, int], int] = lambda *_: ACCEPTED  # block, try
        self.unreadable: set[int] = set()
        self.garbled_reads = 0  # to come
        self.garbled_byte = 0  # of them, the last two being the checksum
        self.garbled_commands = 0  # as the card hears them
        self.status: deque[int] = deque()  # second bytes of R2 to come
        self.deaf_to: set[int] = set()  # commands without an answer
        self.illegal: set[int] = set()
        # What it has seen.
        self.commands: list[int] = []
        self.runs: list[tuple[int, int]] = []  # first block, blocks accepted
        self.tried: dict[int, int] = {}
        self.power_up()

    def power_up(self) -> None:
        """As it comes out of power-on: in SD mode, without a memory of before."""
        self.is_in = True
        self.is_spi = self.is_ready = self.has_crc = self.is_application = False
        self.asked = 0
        self.clocks = 0
        self.busy_until = 0.0
        self.answers: deque[int] = deque()
        self.answers_from = 0.0  # later ones wait for this time
        self.heard = bytearray()
        self.run: int | None = None  # next block
        self.run_first = 0
        self.buffered: list[tuple[int, bytes]] = []
        self.data: bytearray | None = None  # of a block that comes in

    def cut(self) -> None:
        """Power goes: of an open run any block may be there, and one of them torn."""
        torn = self.random.randrange(len(self.buffered) or 1)
        for at, (block, data) in enumerate(self.buffered):
            if at == torn:
                keep = self.random.randrange(BLOCK + 1)
                old = self.content.get(block, ZEROS)
                self.content[block] = data[:keep] + old[keep:]
            elif self.random.random() < 0.5:
                self.content[block] = data
        if self.data is not None:
            self.run = None
        self.power_up()

    def pull(self) -> None:
        self.cut()
        self.is_in = False

    def exchange(
        self, out: bytes, start_us: float, byte_us: float, *, is_selected: bool
    ) -> bytes:
        """Take what is sent and say what comes meanwhile."""
        self.now_us = start_us
        if not self.is_in:
            return b"\xff" * len(out)
        if not is_selected:
            self.clocks += 8 * len(out)
            return b"\xff" * len(out)
        quick = self._quiet(out, start_us, start_us + len(out) * byte_us)
        if quick is not None:
            return quick
        answer = bytearray()
        at = 0
        while at < len(out):
            now = start_us + at * byte_us
            if self.data is not None:
                part = out[at : at + BLOCK + 2 - len(self.data)]
                self.data += part
                answer += b"\xff" * len(part)
                at += len(part)
                if len(self.data) == BLOCK + 2:
                    self._block_is_in(now + len(part) * byte_us)
                continue
            answer.append(self._say(now))
            self._hear(out[at], now)
            at += 1
        return bytes(answer)

    def _quiet(self, out: bytes, start_us: float, end_us: float) -> bytes | None:
        """What comes where nothing is said and nothing changes; None where it may."""
        if self.data is not None or self.heard or out.count(0xFF) < len(out):
            return None
        if self.answers:
            return b"\xff" * len(out) if self.answers_from > end_us else None
        if self.busy_until >= end_us:
            return bytes(len(out))
        return b"\xff" * len(out) if self.busy_until <= start_us else None

    def _say(self, now: float) -> int:
        if self.answers and now >= self.answers_from:
            return self.answers.popleft()
        if not self.answers and now < self.busy_until:
            return 0x00
        return 0xFF

    def _hear(self, byte: int, now: float) -> None:
        if self.heard:
            self.heard.append(byte)
            if len(self.heard) == 6:
                heard, self.heard = bytes(self.heard), bytearray()
                self._obey(heard, now)
        elif self.run is not None and byte == 0xFC:
            assert now >= self.busy_until, "a block while it is busy"
            self.data = bytearray()
        elif self.run is not None and byte == 0xFD:
            assert now >= self.busy_until, "a stop while it is busy"
            self._end_run(now)
        elif byte & 0xC0 == 0x40 and now >= self.busy_until:
            self.heard.append(byte)

    def _end_run(self, now: float) -> None:
        assert self.run is not None
        self.content.update(self.buffered)
        self.runs.append((self.run_first, len(self.buffered)))
        self.buffered = []
        self.run = None
        self.busy_until = now + self.stop_us
        self.answers.append(0xFF)  # a byte before it is busy, 7.5.2.2

    def _block_is_in(self, now: float) -> None:
        assert self.data is not None
        assert self.run is not None
        data, self.data = bytes(self.data), None
        block = self.run
        self.tried[block] = self.tried.get(block, 0) + 1
        answer = self.refuse(block, self.tried[block])
        if crc16(data[:BLOCK]) != int.from_bytes(data[BLOCK:], "big"):
            answer = BAD_CRC
        self.answers.append(answer)
        self.busy_until = now + self.busy_us(block)
        if answer == ACCEPTED:
            self.buffered.append((block, data[:BLOCK]))
            self.run += 1

    def _answer(self, *answer: int) -> None:
        self.answers = deque([0xFF] * self.pause + [*answer])
        self.answers_from = 0.0

    def _obey(self, heard: bytes, now: float) -> None:
        index, argument = heard[0] & 0x3F, int.from_bytes(heard[1:5], "big")
        if not self.is_spi and (index != 0 or self.clocks < 74):
            return
        if index in self.deaf_to:
            return
        self.commands.append(index)
        idle = 0 if self.is_ready else 1
        is_garbled = self.garbled_commands > 0 and index != 0
        if is_garbled:
            self.garbled_commands -= 1
        if (self.has_crc or index in (0, 8)) and (
            is_garbled or heard[5] != crc7(heard[:5]) << 1 | 1
        ):
            self._answer(idle | 0x08)
            return
        was_application, self.is_application = self.is_application, False
        if index in self.illegal or (index == 8 and self.version == 1):
            self._answer(idle | 0x04)
            return
        if index == 0:
            self.is_spi, self.is_ready, self.has_crc = True, False, False
            self.asked = 0
            self.run = None
            self._answer(0x01)
        elif index == 8:
            self._answer(idle, 0, 0, argument >> 8 & self.volts, argument & 0xFF)
        elif index == 59:
            self.has_crc = bool(argument & 1)
            self._answer(idle)
        elif index == 55:
            self.is_application = True
            self._answer(idle)
        elif index == 41 and was_application:
            self.asked += 1
            wants_host = self.is_sdhc and not argument & 0x40000000
            self.is_ready = self.asked > self.starting and not wants_host
            self._answer(0 if self.is_ready else 1)
        elif index == 58:
            self._answer(idle, *self.ocr.to_bytes(4, "big"))
        elif index == 13:
            self._answer(idle, self.status.popleft() if self.status else 0)
        elif not self.is_ready:
            self._answer(idle | 0x04)
        elif index == 16:
            self._answer(0 if argument == BLOCK else 0x40)
        elif index == 9:
            self._give(self.csd, now, 10.0)
        elif index == 12:
            assert self.run is not None, "nothing to stop"
            self._end_run(now)
            self._answer(0)
            self.answers[0] = 0x7F  # means nothing, 7.2.3
        elif index in (17, 25):
            self._access(index, argument, now)
        else:
            self._answer(idle | 0x04)

    def _access(self, index: int, argument: int, now: float) -> None:
        block, rest = (argument, 0) if self.is_sdhc else divmod(argument, BLOCK)
        if rest:
            self._answer(0x20)
        elif block >= self.size:
            self._answer(0x40)
        elif index == 25:
            self.run = self.run_first = block
            self._answer(0)
        elif block in self.unreadable:
            self._answer(0, 0xFF, 0xFF, 0x04)
        else:
            self._give(self.content.get(block, ZEROS), now, self.read_us)

    def _give(self, data: bytes, now: float, after_us: float) -> None:
        checked = data + crc16(data).to_bytes(2, "big")
        if self.garbled_reads > 0:
            self.garbled_reads -= 1
            garbled = bytearray(checked)
            garbled[self.garbled_byte] ^= 1
            checked = bytes(garbled)
        self._answer(0)
        # The answer at once, the token later.
        self.answers.extend([0xFF] * self.random.randrange(1, 4))
        self.answers.append(0xFE)
        self.answers.extend(checked)
        if after_us > 50:
            head = [self.answers.popleft() for _ in range(self.pause + 1)]
            self.answers = _Late(head, self.answers, now + after_us, self)


class _Late(deque[int]):
    """An answer whose second part comes not before a time."""

    def __init__(
        self, head: list[int], tail: deque[int], at: float, card: FakeCard
    ) -> None:
        super().__init__(head)
        self._tail, self._at, self._card = tail, at, card

    def popleft(self) -> int:
        value = super().popleft()
        if not self:
            self._card.answers = self._tail
            self._card.answers_from = self._at
        return value


def csd2(blocks: int) -> bytes:
    """Version 2, 5.3.3."""
    csd = bytearray(16)
    csd[0] = 0x40
    csd[5] = 0x59
    csd[7:10] = (blocks // 1024 - 1).to_bytes(3, "big")
    csd[15] = crc7(bytes(csd[:15])) << 1 | 1
    return bytes(csd)


def csd1(blocks: int, length: int = 9, factor: int = 7) -> bytes:
    """Version 1, 5.3.2."""
    size = blocks // (1 << (factor + 2 + length - 9)) - 1
    csd = bytearray(16)
    csd[5] = 0x50 | length
    csd[6], csd[7], csd[8] = size >> 10, size >> 2 & 0xFF, (size & 3) << 6
    csd[9], csd[10] = factor >> 1, (factor & 1) << 7
    csd[15] = crc7(bytes(csd[:15])) << 1 | 1
    return bytes(csd)
