# SPDX-License-Identifier: MIT
"""Cards to test with: a reader of FAT32 and a writer of a probe's blocks, both written
from the documents and not from our code."""

from __future__ import annotations

import io
import os
import shutil
import struct
import zlib
from dataclasses import dataclass, field
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


@dataclass
class Volume:
    """A card as a computer reads it: after Microsoft's FAT specification."""

    path: Path
    start: int = 0
    partition: int = 0
    cluster: int = 0
    reserved: int = 0
    fat_sectors: int = 0
    total: int = 0
    clusters: int = 0
    data: int = 0
    root: int = 0
    info: tuple[int, int] = (0, 0)
    boot: bytes = b""
    fats: list[list[int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        with self.path.open("rb") as file:
            self._read(file)

    def _read(self, file: io.BufferedReader) -> None:
        def sectors(first: int, count: int = 1) -> bytes:
            file.seek(first * 512)
            return file.read(count * 512)

        table = sectors(0)
        assert table[510:] == b"\x55\xaa"
        status, kind = table[446], table[450]
        assert (status, kind) in {(0, 0x0B), (0, 0x0C)}
        assert not any(table[462:510])
        self.start, self.partition = struct.unpack_from("<II", table, 454)
        boot = self.boot = sectors(self.start)
        assert boot[510:] == b"\x55\xaa"
        assert boot[0] == 0xEB
        assert boot[82:90] == b"FAT32   "
        (size,) = struct.unpack_from("<H", boot, 11)
        assert size == 512
        self.cluster = boot[13]
        (self.reserved,) = struct.unpack_from("<H", boot, 14)
        assert boot[16] == 2
        assert struct.unpack_from("<HH", boot, 17) == (0, 0)
        assert struct.unpack_from("<H", boot, 22) == (0,)
        (hidden, self.total, self.fat_sectors) = struct.unpack_from("<III", boot, 28)
        assert hidden == self.start
        assert self.total == self.partition
        (self.root, info, backup) = struct.unpack_from("<IHH", boot, 44)
        assert sectors(self.start + backup) == boot
        assert sectors(self.start + backup + info) == sectors(self.start + info)
        self.info = self._info(sectors(self.start + info))
        first = self.start + self.reserved
        self.data = first + 2 * self.fat_sectors
        self.clusters = (self.start + self.total - self.data) // self.cluster
        for number in range(2):
            raw = sectors(first + number * self.fat_sectors, self.fat_sectors)
            self.fats.append([e & 0x0FFFFFFF for (e,) in struct.iter_unpack("<I", raw)])
        self.folder = sectors(self.at(self.root), self.cluster)

    @staticmethod
    def _info(sector: bytes) -> tuple[int, int]:
        assert (sector[:4], sector[484:488]) == (b"RRaA", b"rrAa")
        assert sector[508:] == b"\0\0\x55\xaa"
        free, following = struct.unpack_from("<II", sector, 488)
        return free, following

    def at(self, cluster: int) -> int:
        return self.data + (cluster - 2) * self.cluster

    def chain(self, cluster: int) -> list[int]:
        links = []
        while cluster < 0x0FFFFFF8:
            assert 2 <= cluster < self.clusters + 2
            links.append(cluster)
            cluster = self.fats[0][cluster]
        return links

    def entries(self) -> dict[bytes, tuple[int, int, int]]:
        """Attributes, first cluster and length of each entry of the root folder."""
        found = {}
        for at in range(0, len(self.folder), 32):
            entry = self.folder[at : at + 32]
            if entry[0] == 0:
                break
            (high,) = struct.unpack_from("<H", entry, 20)
            low, length = struct.unpack_from("<HI", entry, 26)
            found[entry[:11]] = (entry[11], high << 16 | low, length)
        return found


def program(name: str, package: str) -> str:
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")
    assert found is not None, f"{name} is not here: apt install {package}"
    return found


def partition_of(path: Path, to: Path) -> Path:
    """The partition alone, holes left out: fsck.fat knows no offset."""
    with path.open("rb") as file, to.open("wb") as out:
        start = Volume(path).start * 512
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
    """Offset of the log in an image, its length, and the card's id."""
    volume = Volume(path)
    _, first, length = volume.entries()[b"PROBE   LOG"]
    offset = volume.at(first) * 512
    with path.open("rb") as file:
        file.seek(offset + 12)
        return offset, length, int.from_bytes(file.read(4), "little")


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
