# SPDX-License-Identifier: MIT
"""The card of a probe: prepared for it, and its recordings found, counted, and written
as the same MCAP that a live log is. The format: docs/card.md.
"""

from __future__ import annotations

import contextlib
import secrets
import struct
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from msgspec.structs import replace

from imud.card import disk, fat
from imud.card.disk import Disk
from imud.card.fat import SECTOR
from imud.errors import ConfigError, FileError
from imud.log.file import LogFile, Settings
from imud.probes.boot import difference_32
from imud.probes.ledger import totals
from imud.probes.record import record_of
from imud.probes.session import (
    NOBODY,
    OtherSchema,
    Probe,
    Received,
    Session,
    first_hello,
    speaker_of,
)
from imud.progress import Progress
from imud.wire import schema
from imud.wire.frame import HELLO_ID, FrameDecoder
from imud.wire.messages import Message, decode

MAGIC = b"IMUPROBE"
VERSION = 1

FIRST, LAST = 1, 2  # flags of a block

_HEAD = struct.Struct("<8sHHIII")
_BLOCK = struct.Struct("<IIHBx")
_HEADER = struct.Struct(schema.HEADER)
_CRC_AT = SECTOR - 4
_WORDS = SECTOR // 4

# Blocks looked through at once: 1 MiB. As many with none good are the end.
_LOOK = 2048
# Blocks decoded at once: some hundred messages, so that a bar moves.
_DECODE = 64
# Bad blocks among good ones that the probe's search for the end steps over.
_WORN_MAX = 8

# The MBR is written last; a GPT, which a computer would rather believe, has its copy in
# this many sectors at the end.
_GPT_COPY = 33

# What a card gives its size in (CSD, C_SIZE).
_CARD_UNIT = 512 << 10


def head_block(card_id: int, lba: int, blocks: int) -> bytes:
    """Block 0: whose log this is and where it belongs."""
    head = _HEAD.pack(MAGIC, VERSION, SECTOR, card_id, lba, blocks)
    return _sealed(head.ljust(_CRC_AT, b"\0"))


def _sealed(block: bytes) -> bytes:
    return block + crc32(block).to_bytes(4, "little")


@dataclass(slots=True)
class Recording:
    """From one start of the log to its end, or to where power was cut."""

    number: int
    runs: list[range] = field(default_factory=list)  # of good blocks
    is_begun: bool = False  # its first block is there
    is_ended: bool = False
    bad: int = 0  # blocks among the good ones that are torn or worn

    @property
    def blocks(self) -> int:
        return sum(len(run) for run in self.runs)


class CardLog:
    """PROBE.LOG on a card, in an image of one, or copied from one."""

    def __init__(self, card: Disk, place: fat.Found) -> None:
        self._disk = card
        self._offset = place.offset
        head = card.read_at(place.offset, SECTOR)
        if len(head) < SECTOR or head[:8] != MAGIC or _sealed(head[:_CRC_AT]) != head:
            raise FileError(f"{card.path}: its PROBE.LOG was not prepared for a probe")
        _, version, size, self.card_id, self.lba, self.blocks = _HEAD.unpack_from(head)
        if (version, size) != (VERSION, SECTOR):
            raise FileError(
                f"{card.path} holds a log of version {version}, this imud reads "
                f"{VERSION}: use the imud of its time"
            )
        there = min(place.size, card.bytes - place.offset) // SECTOR
        self.blocks = min(self.blocks, there)  # a copy may have been cut short

    def good(self, first: int, count: int) -> list[tuple[int, int, int]]:
        """Number, recording and flags of each good block among these."""
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
        """About where the log ends, in a few looks."""
        low, high = 1, self.blocks
        while low < high:
            middle = (low + high) // 2
            if self.good(middle, _WORN_MAX + 1):
                low = middle + 1
            else:
                high = middle
        return low

    def recordings(self) -> list[Recording]:
        """All there are, by number. Every block up to the end is checked."""
        found: dict[int, Recording] = {}
        bar = Progress("looking", self.used())
        recording: Recording | None = None
        after = 1  # where the next block of it would be
        for first in range(1, self.blocks, _LOOK):
            blocks = self.good(first, _LOOK)
            if not blocks:
                break
            for number, name, flags in blocks:
                if recording is not None:
                    recording.bad += number - after
                if recording is None or recording.number != name or number != after:
                    recording = found.setdefault(name, Recording(name))
                    recording.runs.append(range(number, number))
                recording.runs[-1] = range(recording.runs[-1].start, number + 1)
                recording.is_begun |= bool(flags & FIRST)
                recording.is_ended |= bool(flags & LAST)
                after = number + 1
            bar.update(first)
        bar.end()
        return [found[name] for name in sorted(found)]

    def frames(self, recording: Recording) -> Iterator[bytes]:
        """The bytes of a recording.

        They run on behind a worn place, which the probe has left out; behind a block
        that was spoilt later a frame begins anew.
        """
        begun = b""  # the frame that the last block has begun
        for run in recording.runs:
            for first in range(run.start, run.stop, _DECODE):
                data = self._read(first, min(_DECODE, run.stop - first))
                blocks = np.frombuffer(data, np.uint8).reshape(-1, SECTOR)
                content = blocks[:, _BLOCK.size : _CRC_AT].tobytes()
                if first == run.start and begun:
                    end = content.find(0) + 1
                    if not FrameDecoder().feed(begun + content[:end]):
                        yield b"\0"
                yield content
                begun = content[content.rfind(0) + 1 :]
        yield b"\0"  # the last may be cut off

    def _read(self, first: int, count: int) -> bytes:
        if count <= 0:
            return b""
        offset = self._offset + first * SECTOR
        try:
            return self._disk.read_at(offset, count * SECTOR)
        except OSError:  # a place that a worn card gives no more
            if count == 1:
                return bytes(SECTOR)
            half = count // 2
            return self._read(first, half) + self._read(first + half, count - half)


def find_log(card: Disk) -> CardLog:
    """The log of a card, of its image, or of a copy of the file."""
    if card.read_at(0, len(MAGIC)) == MAGIC:
        return CardLog(card, fat.Found(0, card.bytes))
    try:
        place = fat.find_log(card.read)
    except fat.NoLog as reason:
        raise FileError(
            f"{card.path} is no card of a probe: {reason}; imud card prepare makes one"
        ) from reason
    return CardLog(card, place)


# prepare


def prepare(
    path: Path, *, size: int | None, log_size: int | None, is_agreed: bool
) -> int:
    """Makes a card, or an image of one, ready for a probe."""
    if size is not None:
        if size % _CARD_UNIT:
            raise ConfigError(f"--size {size} is not a multiple of 512K, as cards are")
        if path.exists():
            raise FileError(f"{path} is there; --size is for an image that is not")
        layout = _lay_out(path, size // SECTOR, log_size)
        with disk.created(path, size) as card:
            _write(card, layout, is_fresh=True)
        return 0
    if not path.exists() and path.parent.is_dir() and path.parent != Path("/dev"):
        raise FileError(f"{path} is not there; --size BYTES makes an image")
    with disk.claimed(path) as card:
        layout = _lay_out(path, card.sectors, log_size)
        if not is_agreed:
            _ask(card)
        _write(card, layout, is_fresh=False)
    return 0


def _lay_out(path: Path, sectors: int, log_size: int | None) -> fat.Layout:
    try:
        return fat.lay_out(sectors, log_size)
    except FileError as error:
        raise FileError(f"{path}: {error}") from error


def _ask(card: Disk) -> None:
    if not sys.stdin.isatty():
        raise FileError(
            f"{card.path} ({_size(card.bytes)}, {_what_is_on(card)}) would be "
            "overwritten; say --yes"
        )
    sys.stderr.write(
        f"{card.path} has {_size(card.bytes)} and holds {_what_is_on(card)}.\n"
        "All of it will be lost. Type yes to go on: "
    )
    sys.stderr.flush()
    if sys.stdin.readline().strip() != "yes":
        raise FileError(f"{card.path} was left as it is")


def _what_is_on(card: Disk) -> str:
    try:
        log = find_log(card)
    except FileError:
        return _what_else_is_on(card.read_at(0, _LOOK * SECTOR))
    used = log.used() - 1
    if used == 0:
        return "the empty log of a probe"
    return f"the log of a probe, {_size(used * SECTOR)} of it written"


def _what_else_is_on(begin: bytes) -> str:
    if fat.is_boot_sector(begin[:SECTOR]):
        return "a FAT32 file system"
    types = fat.partition_types(begin[:SECTOR])
    if types:
        names = ", ".join(f"{each:#04x}" for each in types)
        return f"{_plural(len(types), 'partition')} (type {names})"
    return "something else" if any(begin) else "nothing at its start"


def _write(card: Disk, layout: fat.Layout, *, is_fresh: bool) -> None:
    card_id = secrets.randbelow(2**32 - 1) + 1
    identity = secrets.randbits(32)
    now = time.localtime()
    table = fat.partition_table(layout, identity)
    head = head_block(card_id, layout.log, layout.log_sectors)

    def pieces() -> Iterator[tuple[int, bytes]]:
        yield 0, bytes(SECTOR)  # no card of a probe until all of it is written
        yield from fat.sectors_before_log(layout, identity, now)
        yield layout.log, head
        yield card.sectors - _GPT_COPY, bytes(_GPT_COPY * SECTOR)

    bar = Progress("preparing", 2 * layout.log)
    try:
        for sector, data in pieces():
            # The zeros of a fresh image are there already and take no room.
            if not is_fresh or any(data):
                card.write(sector, data)
            bar.update(min(sector, layout.log))
        card.settle()
        card.write(0, table)
        card.settle()
        for sector, data in pieces():
            if card.read(sector, len(data) // SECTOR) != (data if sector else table):
                raise FileError(
                    f"{card.path} does not keep what is written to it (sector "
                    f"{sector}); take another card"
                )
            bar.update(layout.log + min(sector, layout.log))
    finally:
        bar.end()
    card.reread()
    log_bytes = layout.log_sectors * SECTOR
    sys.stdout.write(
        f"{card.path} is ready: card {card_id:08x}, {_size(card.bytes)}, its log "
        f"{_size(log_bytes)}\n"
    )


# read and list


@dataclass(slots=True)
class Survey:
    """What a recording holds, from the heads of its messages."""

    probe: str = NOBODY
    messages: Counter[int] = field(default_factory=Counter)  # by their id
    last_sequence: int = -1
    duration_us: int = 0

    @property
    def samples(self) -> int:
        """Raw messages, one a sample; where none were asked for, poses."""
        return self.messages[_ID["raw"]] or self.messages[_ID["pose"]]

    @property
    def lost(self) -> int:
        """Numbers that are missing; a recording's first is 0."""
        return self.last_sequence + 1 - self.messages.total()


_ID = {message.name: message.id for message in schema.MESSAGES}


def survey(log: CardLog, recording: Recording, bar: Progress) -> Survey:
    found = Survey()
    decoder = FrameDecoder()
    before_us: int | None = None
    for data in log.frames(recording):
        for content in decoder.feed(data):
            if len(content) < _HEADER.size:
                continue
            kind, sequence, time_us = _HEADER.unpack_from(content)
            if sequence <= found.last_sequence:  # a block that was written twice
                continue
            found.messages[kind] += 1
            found.last_sequence = sequence
            if before_us is not None:
                found.duration_us += difference_32(time_us, before_us)
            before_us = time_us
            if kind == HELLO_ID and found.probe == NOBODY:
                hello = decode(content)
                probe_id = hello.fields["probe_id"] if isinstance(hello, Message) else 0
                found.probe = probe_id.hex() if isinstance(probe_id, bytes) else NOBODY
        bar.advance(len(data))
    return found


def show(path: Path) -> int:
    """Prints a line for each recording."""
    with disk.opened(path) as card:
        log = find_log(card)
        recordings = log.recordings()
        sys.stdout.write(_summary(log, recordings))
        rows = [("recording", "probe", "duration", "samples", "lost", "bad", "end")]
        bar = _bar(recordings)
        for recording in recordings:
            found = survey(log, recording, bar)
            sent = found.last_sequence + 1
            rows.append(
                (
                    f"{recording.number}",
                    found.probe,
                    _duration(found.duration_us),
                    f"{found.samples}",
                    f"{found.lost} of {sent}",
                    _plural(recording.bad, "block"),
                    _end(recording),
                )
            )
        bar.end()
    if recordings:
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
            sys.stdout.write("  ".join(cells).rstrip() + "\n")
    return 0


def read(
    path: Path,
    *,
    to: Path,
    prefix: str,
    number: int | None,
    started_ns: int | None,
) -> int:
    """Writes each recording as a log of its own, and says what was found."""
    with disk.opened(path) as card:
        log = find_log(card)
        recordings = log.recordings()
        sys.stdout.write(_summary(log, recordings))
        if number is not None:
            there = ", ".join(str(each.number) for each in recordings) or "none"
            recordings = [each for each in recordings if each.number == number]
            if not recordings:
                raise FileError(f"{path} has no recording {number}; it has {there}")
        if started_ns is not None and len(recordings) > 1:
            raise ConfigError("--started is of one recording: say --recording N, too")
        with disk.told(f"write to {to}", "; name another place with --to DIR"):
            to.mkdir(parents=True, exist_ok=True)
        bar = _bar(recordings)
        writer = _LogWriter(log, to, prefix, started_ns, bar)
        try:
            lines = [writer.write(recording) for recording in recordings]
        finally:
            bar.end()
    if started_ns is None and any(line.is_written for line in lines):
        sys.stdout.write(
            "times are the device's, from 1970 on; --started UTC --recording N sets "
            "them right\n"
        )
    unread = sum(line.is_unread for line in lines)
    if unread:
        raise FileError(f"{_plural(unread, 'recording')} of {path} can't be read")
    return 0


@dataclass(frozen=True, slots=True)
class _Outcome:
    is_written: bool = False
    is_unread: bool = False


class _LogWriter:
    """Turns recordings into logs, each of them whole or not there."""

    def __init__(
        self,
        log: CardLog,
        to: Path,
        prefix: str,
        started_ns: int | None,
        bar: Progress,
    ) -> None:
        self._log = log
        self._to = to
        self._prefix = prefix
        self._started_ns = started_ns
        self._bar = bar

    def write(self, recording: Recording) -> _Outcome:
        name = f"recording {recording.number}"
        hello = first_hello(self._log.frames(recording))
        probes: dict[str, Probe] = {}

        def find(probe_id: str) -> Probe:
            return probes.setdefault(probe_id, Probe(probe_id))

        probe = speaker_of(hello, find)
        stem = f"card-{self._log.card_id:08x}-{probe.probe_id}-{recording.number}"
        path = self._to / f"{stem}.mcap"
        if path.exists():
            self._say(f"{name}: {path} is there already")
            return _Outcome()
        part = path.with_name(f"{path.name}.part")
        with disk.told(f"write {path}", "; name another place with --to DIR"):
            file = part.open("wb")
            log = LogFile(file, Settings(prefix=self._prefix))
            try:
                found = self._copy(recording, Session(find, None, probe), log)
                log.finish()
                log.close()
                if found.messages and found.other is None:
                    part.rename(path)
                else:
                    part.unlink()
            except BaseException:
                with contextlib.suppress(OSError):
                    log.close()
                part.unlink(missing_ok=True)
                raise
        if found.other is not None:
            self._say(
                f"{name}: probe {found.other.probe_id} speaks schema "
                f"{found.other.fingerprint:#010x} (firmware {found.other.firmware}), "
                f"this imud speaks {schema.FINGERPRINT:#010x}: use the imud of its time"
            )
            return _Outcome(is_unread=True)
        if not found.messages:
            self._say(f"{name}: no message in it")
            return _Outcome()
        self._say(f"{name}: {_account(recording, probe, found)}: {path}")
        return _Outcome(is_written=True)

    def _copy(self, recording: Recording, session: Session, log: LogFile) -> _Copied:
        found = _Copied()
        for data in self._log.frames(recording):
            for event in session.receive(data, None):
                if isinstance(event, OtherSchema):
                    found.other = event
                elif isinstance(event, Received):
                    self._take(event, found, log)
            self._bar.advance(len(data))
        for event in session.close():
            if isinstance(event, Received):
                self._take(event, found, log)
        found.corrupt = session.corrupt.total() + session.partial
        return found

    def _take(self, event: Received, found: _Copied, log: LogFile) -> None:
        t_device_us = event.stamp.t_device_us
        if not found.messages:
            found.first_us = found.last_us = t_device_us
            found.first_sequence = event.message.sequence
        found.messages[event.message.name] += 1
        found.last_us = max(found.last_us, t_device_us)
        t_ns = t_device_us * 1000
        if self._started_ns is not None:
            t_ns += self._started_ns - found.first_us * 1000
        probe = event.probe
        t_ns = max(0, t_ns)
        stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
        hello, content = probe.hello, probe.hello_content
        log.take(
            record_of(
                event.message, event.content, probe.probe_id, stamp, hello, content
            )
        )

    def _say(self, text: str) -> None:
        self._bar.wipe()
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


@dataclass(slots=True)
class _Copied:
    messages: Counter[str] = field(default_factory=Counter)
    first_sequence: int = 0
    first_us: int = 0
    last_us: int = 0
    corrupt: int = 0
    other: OtherSchema | None = None


def _account(recording: Recording, probe: Probe, found: _Copied) -> str:
    counts: Any = probe.account.counts()
    total = totals(counts)
    # Numbers begin with 0 in each recording: those before the first heard are lost.
    before = found.first_sequence
    parts = [
        f"probe {probe.probe_id}",
        _duration(found.last_us - found.first_us),
        f"{found.messages['raw']} raw, {found.messages['pose']} pose",
        f"{before + total.sent} sent = {total.received} received + "
        f"{total.skewed.total()} skewed + {before + total.lost} lost",
    ]
    if total.duplicated:
        parts.append(f"{total.duplicated} duplicated")
    if counts["strays"]:
        parts.append(f"{counts['strays']} stray")
    if recording.bad:
        parts.append(f"{_plural(recording.bad, 'block')} torn or worn")
    if found.corrupt:
        parts.append(f"{_plural(found.corrupt, 'frame')} torn")
    return ", ".join([*parts, _end(recording)])


def _bar(recordings: list[Recording]) -> Progress:
    size = _CRC_AT - _BLOCK.size
    return Progress("reading", sum(each.blocks for each in recordings) * size)


def _summary(log: CardLog, recordings: list[Recording]) -> str:
    written = sum(each.blocks for each in recordings)
    bad = sum(each.bad for each in recordings)
    return (
        f"card {log.card_id:08x}: {_plural(len(recordings), 'recording')}, "
        f"{written} of {log.blocks - 1} blocks written, {bad} torn or worn\n"
    )


def _end(recording: Recording) -> str:
    begin = "" if recording.is_begun else "its first block is lost, "
    return begin + ("ended cleanly" if recording.is_ended else "cut off")


def _duration(duration_us: int) -> str:
    minutes, rest_us = divmod(duration_us, 60_000_000)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest_us / 1e6:04.1f}"


def _size(count: int) -> str:
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= unit:
            return f"{count / unit:.1f} {name}"
    return f"{count} bytes"


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
