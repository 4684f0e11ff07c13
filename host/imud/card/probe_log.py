# SPDX-License-Identifier: MIT
"""PROBE.LOG, the log area of a card: finds its recordings and their bytes. The format
is in docs/f405.md. Nothing here writes to a card.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from imud.card import fat
from imud.card.disk import Disk
from imud.card.fat import SECTOR
from imud.errors import FileError
from imud.progress import Progress
from imud.wire.frame import FrameDecoder
from imud.wire.kept import fingerprints

MAGIC = b"IMUPROBE"
VERSION = 1

FIRST, LAST = 1, 2  # flags: a block is the first or the last of its recording

_HEAD = struct.Struct("<8sHHIII")
_BLOCK = struct.Struct("<IIHBx")
_CRC_AT = SECTOR - 4
_WORDS = SECTOR // 4

# Blocks checked at once: 1 MiB. This many without a good one mark the end of the log.
LOOK = 2048
# Blocks decoded at once: some hundred messages, so that the progress bar moves.
_DECODE = 64
# Bad blocks in a row that the probe's search for the end steps over.
_WORN_MAX = 8
CONTENT = _CRC_AT - _BLOCK.size  # bytes of the recording in a block


def head_block(card_id: int, lba: int, blocks: int) -> bytes:
    """Block 0 of the log: the card's id, the log's first sector and its blocks."""
    head = _HEAD.pack(MAGIC, VERSION, SECTOR, card_id, lba, blocks)
    return _sealed(head.ljust(_CRC_AT, b"\0"))


def _sealed(block: bytes) -> bytes:
    return block + crc32(block).to_bytes(4, "little")


@dataclass(slots=True)
class CardRecording:
    """Blocks from one start of the log to its end, or to where power was cut."""

    number: int
    runs: list[range] = field(default_factory=list)  # of good blocks
    is_begun: bool = False  # its first block was found
    is_ended: bool = False  # its last block was found
    bad: int = 0  # blocks among the good ones that are torn or worn

    @property
    def blocks(self) -> int:
        return sum(len(run) for run in self.runs)


class CardLog:
    """PROBE.LOG on a card, in the image of one, or copied from one.

    Raises FileError if it was not prepared for a probe or has another version.
    """

    def __init__(self, card: Disk, place: fat.LogExtent) -> None:
        self._disk = card
        self._offset = place.offset
        head = card.read_at(place.offset, SECTOR)
        if len(head) < SECTOR or head[:8] != MAGIC or _sealed(head[:_CRC_AT]) != head:
            raise FileError(f"{card.path}: its PROBE.LOG was not prepared for a probe")
        _, version, size, self.card_id, self.lba, self.blocks = _HEAD.unpack_from(head)
        if (version, size) != (VERSION, SECTOR):
            raise FileError(
                f"{card.path} has a log of version {version}, this imud reads "
                f"{VERSION}: use the version that wrote it"
            )
        there = min(place.size, card.bytes - place.offset) // SECTOR
        self.blocks = min(self.blocks, there)  # a copy may have been cut short

    def good(self, first: int, count: int) -> list[tuple[int, int, int]]:
        """Block number, recording and flags of each good block in a range."""
        data = memoryview(self._read(first, min(count, self.blocks - first)))
        words = np.frombuffer(data, "<u4").reshape(-1, _WORDS)
        expected = np.arange(first, first + len(words), dtype=np.uint32)
        is_likely = (words[:, 0] == self.card_id) & (words[:, 1] == expected)
        found = []
        for index in np.flatnonzero(is_likely).tolist():
            block = data[index * SECTOR : (index + 1) * SECTOR]
            if crc32(block[:_CRC_AT]) == int.from_bytes(block[_CRC_AT:], "little"):
                _, number, recording, flags = _BLOCK.unpack_from(block)
                found.append((number, recording, flags))
        return found

    def used(self) -> int:
        """The block at which the log roughly ends, by bisection."""
        low, high = 1, self.blocks
        while low < high:
            middle = (low + high) // 2
            if self.good(middle, _WORN_MAX + 1):
                low = middle + 1
            else:
                high = middle
        return low

    def recordings(self) -> list[CardRecording]:
        """All recordings, sorted by number. Checks every block up to the end."""
        found: dict[int, CardRecording] = {}
        bar = Progress("looking", self.used())
        recording: CardRecording | None = None
        after = 1  # where the next block of it would be
        for first in range(1, self.blocks, LOOK):
            blocks = self.good(first, LOOK)
            if not blocks:
                break
            for number, name, flags in blocks:
                if recording is not None:
                    recording.bad += number - after
                if recording is None or recording.number != name or number != after:
                    recording = found.setdefault(name, CardRecording(name))
                    recording.runs.append(range(number, number))
                recording.runs[-1] = range(recording.runs[-1].start, number + 1)
                recording.is_begun |= bool(flags & FIRST)
                recording.is_ended |= bool(flags & LAST)
                after = number + 1
            bar.update(first)
        bar.end()
        return [found[name] for name in sorted(found)]

    def frames(self, recording: CardRecording) -> Iterator[bytes]:
        """The bytes of a recording, as chunks of whole blocks.

        A frame continues after a worn block, which the probe skipped when it wrote. It
        does not continue after a block that was damaged later.
        """
        begun = b""  # the start of a frame at the end of the last block
        for run in recording.runs:
            for first in range(run.start, run.stop, _DECODE):
                data = self._read(first, min(_DECODE, run.stop - first))
                blocks = np.frombuffer(data, np.uint8).reshape(-1, SECTOR)
                content = blocks[:, _BLOCK.size : _CRC_AT].tobytes()
                if first == run.start and begun:
                    end = content.find(0) + 1
                    frame = begun + content[:end]
                    if not any(FrameDecoder(f).feed(frame) for f in fingerprints()):
                        yield b"\0"
                yield content
                begun = content[content.rfind(0) + 1 :]
        yield b"\0"  # ends the last frame, which may be cut off

    def _read(self, first: int, count: int) -> bytes:
        if count <= 0:
            return b""
        offset = self._offset + first * SECTOR
        try:
            return self._disk.read_at(offset, count * SECTOR)
        except OSError:  # a sector of a worn card that can't be read
            if count == 1:
                return bytes(SECTOR)
            half = count // 2
            return self._read(first, half) + self._read(first + half, count - half)


def find_log(card: Disk) -> CardLog:
    """Finds the log on a card, in its image, or as a copy of the file; or FileError."""
    if card.read_at(0, len(MAGIC)) == MAGIC:
        return CardLog(card, fat.LogExtent(0, card.bytes))
    try:
        place = fat.find_log(card.read)
    except fat.NoLog as reason:
        raise FileError(
            f"{card.path} is not a probe's card: {reason}; prepare one with imud card "
            "prepare"
        ) from reason
    return CardLog(card, place)
