# SPDX-License-Identifier: MIT
"""Cards to test with, and a writer of a probe's blocks from the documents and not from
our code."""

from __future__ import annotations

import io
import os
import shutil
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import pytest

from fakes import FakeProbe
from imud import cli
from imud.log.reader import Logged
from imud.wire.frame import encode_frame
from log_files import read_log

MIB = 1 << 20
SMALL = 34 * MIB


def run(*arguments: object) -> int:
    return cli.main(["card", *map(str, arguments)])


def prepared(path: Path, size: int = SMALL) -> Path:
    assert run("prepare", path, "--size", size) == 0
    return path


def start_of(path: Path) -> int:
    """The first sector of the first partition: at 454 in a partition table."""
    with path.open("rb") as file:
        return int.from_bytes(file.read(512)[454:458], "little")


def program(name: str, package: str) -> str:
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    assert found is not None, f"{name} is not here: apt install {package}"
    return found


def partition_of(path: Path, to: Path) -> Path:
    """The partition alone, holes left out: fsck.fat knows no offset."""
    with path.open("rb") as file, to.open("wb") as out:
        start = start_of(path) * 512
        size = path.stat().st_size
        out.truncate(size - start)
        at = start
        while at < size:
            try:
                at = os.lseek(file.fileno(), at, os.SEEK_DATA)
            except OSError:
                break
            end = os.lseek(file.fileno(), at, os.SEEK_HOLE)
            out.seek(at - start)
            out.write(os.pread(file.fileno(), end - at, at))
            at = end
    return to


def sealed(block: bytes) -> bytes:
    return block + struct.pack("<I", zlib.crc32(block))


def block_of(
    card_id: int, number: int, recording: int, flags: int, payload: bytes
) -> bytes:
    head = struct.pack("<IIHBB", card_id, number, recording, flags, 0)
    return sealed(head + payload.ljust(496, b"\0"))


@dataclass
class TapedMessage:
    """One message of a recording: its content and the blocks that hold its frame,
    but for the zero at its end, for which any other will do."""

    content: bytes
    blocks: range


@dataclass
class Taped:
    """A recording as a probe writes it: payloads of blocks and what is in them."""

    payloads: list[bytes]
    messages: list[TapedMessage]
    is_ended: bool = True


def tape(
    contents: list[bytes], *, flushed: set[int] | None = None, is_ended: bool = True
) -> Taped:
    """Frames run on over blocks; after those of `flushed` comes the next block."""
    payloads = [b""]
    messages = []
    for index, content in enumerate(contents):
        frame = encode_frame(content)
        if len(payloads[-1]) == 496:
            payloads.append(b"")
        first = len(payloads) - 1
        while frame:
            room = 496 - len(payloads[-1])
            payloads[-1] += frame[:room]
            frame = frame[room:]
            if frame:
                payloads.append(b"")
        end = len(payloads) - (len(payloads[-1]) == 1)
        messages.append(TapedMessage(content, range(first, end)))
        if index in (flushed or set()) and index < len(contents) - 1:
            payloads.append(b"")
    return Taped(payloads, messages, is_ended)


def contents_of(probe: FakeProbe, count: int = 40) -> list[bytes]:
    """A recording's messages: numbers from 0, a hello first, then what comes."""
    probe.sequence = 0
    contents = [probe.content("hello")]
    for index in range(count):
        kind = ("raw", "pose", "raw", "pose", "raw", "pose", "status", "equipment")
        contents.append(probe.content(kind[index % 8]))
    return contents


def blocks_of(
    probes: list[FakeProbe], card_id: int = 0, count: int = 40
) -> list[bytes]:
    """A recording of each, one after the other; card_id 0: of the card they go to."""
    tapes = [tape(contents_of(probe, count)) for probe in probes]
    return laid(tapes, card_id)


def laid(tapes: list[Taped], card_id: int = 0) -> list[bytes]:
    blocks: list[bytes] = []
    for recording, each in enumerate(tapes, 1):
        last = len(each.payloads) - 1
        for index, payload in enumerate(each.payloads):
            flags = (index == 0) | (index == last and each.is_ended) << 1
            number = len(blocks) + 1
            blocks.append(block_of(card_id, number, recording, flags, payload))
    return blocks


def place_of(path: Path) -> tuple[int, int, int]:
    """Offset of the log in an image, its length, and the card's id: all by its head,
    which begins where a card erases.
    """
    with path.open("rb") as file:
        for offset in range(0, file.seek(0, os.SEEK_END), 1 << 16):
            file.seek(offset)
            head = file.read(24)
            if head.startswith(b"IMUPROBE"):
                card_id, _, blocks = struct.unpack_from("<III", head, 12)
                return offset, blocks * 512, card_id
    raise AssertionError(f"{path} has no log")


def with_log(path: Path, blocks: list[bytes]) -> Path:
    """Writes blocks from 1 on; those of card 0 become this card's."""
    offset, _, card_id = place_of(path)
    with path.open("r+b") as file:
        for number, block in enumerate(blocks, 1):
            if block[:4] == bytes(4) and len(block) == 512 and any(block):
                block = sealed(card_id.to_bytes(4, "little") + block[4:508])
            file.seek(offset + number * 512)
            file.write(block)
    return path


def log_of(path: Path) -> bytes:
    offset, length, _ = place_of(path)
    with path.open("rb") as file:
        file.seek(offset)
        return file.read(length)


def bare(tmp_path: Path, blocks: list[bytes], card_id: int = 0x1234) -> Path:
    """A copy of PROBE.LOG with room for a few blocks behind what is written."""
    head = struct.pack("<8sHHIII", b"IMUPROBE", 1, 512, card_id, 8192, len(blocks) + 41)
    path = tmp_path / "PROBE.LOG"
    path.write_bytes(
        sealed(head.ljust(508, b"\0")) + b"".join(blocks) + bytes(512) * 40
    )
    return path


def frames_of(path: Path) -> list[bytes]:
    logged = [item for item in read_log(path) if isinstance(item, Logged)]
    return [item.data for item in logged if item.topic == "frame"]


def logs_in(folder: Path) -> dict[int, Path]:
    logs = {int(p.stem.rsplit("-", 1)[1]): p for p in folder.glob("card-*.mcap")}
    return dict(sorted(logs.items()))


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().out.splitlines()


def error_of(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert run(*arguments) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("imud: ")
    assert captured.err.count("\n") == 1
    return captured.err[6:-1]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True
