# SPDX-License-Identifier: MIT
"""`imud card`: what is prepared is a FAT32 that others read; what a probe has written
comes back message by message, whatever the card went through.

The FAT reader and the writer of blocks are the tests' own, after the documents.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from msgspec.structs import replace

from fakes import FakeProbe
from imud import cli
from imud.card import card, disk, fat
from imud.card.disk import Disk
from imud.errors import FileError
from imud.log.reader import Logged, read_log
from imud.probes.record import record_of
from imud.probes.session import Probe, Received, Session
from imud.sinks.log import LogSink
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import decode

MIB = 1 << 20
GIB = 1 << 30
SMALL = 34 * MIB
SIZES = [SMALL, *(n * MIB for n in (64, 260, 261, 1024, 2048, 4096, 8192, 32768))]


def run(*arguments: object) -> int:
    return cli.main(["card", *map(str, arguments)])


def prepared(path: Path, size: int = SMALL) -> Path:
    assert run("prepare", path, "--size", size) == 0
    return path


# A FAT reader of its own.


@dataclass
class Volume:
    """What a computer sees on a card: after Microsoft's FAT specification."""

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


@pytest.mark.parametrize("size", SIZES)
def test_a_prepared_card_is_a_fat32_with_one_file_in_one_piece(
    tmp_path: Path, size: int
) -> None:
    path = prepared(tmp_path / "card.img", size)
    volume = Volume(path)
    assert path.stat().st_size == size
    assert (volume.start + volume.partition) * 512 == size
    # A FAT with fewer clusters is no FAT32, whatever it says of itself.
    assert volume.clusters >= 65525
    assert volume.clusters + 2 <= volume.fat_sectors * 128
    assert volume.fats[0] == volume.fats[1]
    entries = volume.entries()
    assert list(entries) == [b"IMU-PROBE  ", b"PROBE   LOG"]
    assert volume.boot[71:82] == b"IMU-PROBE  "
    assert entries[b"IMU-PROBE  "] == (0x08, 0, 0)
    attributes, first, length = entries[b"PROBE   LOG"]
    assert attributes & 0x18 == 0
    chain = volume.chain(first)
    assert chain == list(range(first, first + len(chain)))
    assert len(chain) == -(-length // (volume.cluster * 512))
    used = sum(1 for entry in volume.fats[0][2 : volume.clusters + 2] if entry)
    assert used == len(chain) + len(volume.chain(volume.root))
    assert volume.info[0] == volume.clusters - used
    assert volume.fats[0][volume.info[1]] == 0
    free = (volume.clusters - used) * volume.cluster * 512
    assert length == 4 * GIB - volume.cluster * 512 or MIB <= free < 6 * MIB


@pytest.mark.parametrize("size", SIZES)
def test_the_log_has_its_head_and_begins_where_a_card_erases(
    tmp_path: Path, size: int
) -> None:
    path = prepared(tmp_path / "card.img", size)
    volume = Volume(path)
    _, first, length = volume.entries()[b"PROBE   LOG"]
    lba = volume.at(first)
    with path.open("rb") as file:
        file.seek(lba * 512)
        head = file.read(512)
    magic, version, block, card_id, place, blocks = struct.unpack_from("<8sHHIII", head)
    assert (magic, version, block) == (b"IMUPROBE", 1, 512)
    assert card_id > 0
    assert (place, blocks) == (lba, length // 512)
    assert not any(head[24:508])
    assert int.from_bytes(head[508:], "little") == zlib.crc32(head[:508])
    unit = 65536 if size <= 2 * GIB else 4 * MIB
    assert [n * 512 % unit for n in (volume.start, volume.data, lba)] == [0, 0, 0]


def test_clusters_are_as_large_as_may_be() -> None:
    """A FAT of a megabyte at most is to be followed, whatever the card."""
    sizes = {34: 1, 64: 1, 260: 8, 1024: 16, 2048: 32, 4096: 64, 8192: 64, 65536: 64}
    for mebibytes, sectors in sizes.items():
        layout = fat.lay_out(mebibytes * MIB // 512)
        assert layout.cluster == sectors
        assert layout.log_clusters * 4 <= MIB


def test_an_image_takes_the_room_of_its_tables_alone(tmp_path: Path) -> None:
    path = prepared(tmp_path / "card.img", 32 * GIB)
    assert path.stat().st_blocks * 512 < 8 * MIB


@given(sectors=st.integers(SMALL // 512, 2**32 - 1))
def test_every_size_of_card_is_laid_out_by_the_rules(sectors: int) -> None:
    layout = fat.lay_out(sectors)
    unit = 128 if sectors <= 1 << 22 else 8192
    assert layout.clusters >= 65525 + 16
    assert (layout.clusters + 2) * 4 <= layout.fat * 512
    assert 32 <= layout.reserved <= 65535
    assert [n % unit for n in (layout.start, layout.data, layout.log)] == [0, 0, 0]
    end = layout.data + layout.clusters * layout.cluster
    assert sectors - layout.cluster < end <= sectors
    assert layout.log + layout.log_clusters * layout.cluster <= end
    assert layout.log_clusters * layout.cluster * 512 < 2**32


def test_a_log_can_be_made_smaller_and_not_larger_than_the_card(tmp_path: Path) -> None:
    path = tmp_path / "card.img"
    assert run("prepare", path, "--size", "64M", "--log-size", "1M") == 0
    assert Volume(path).entries()[b"PROBE   LOG"][2] == MIB
    most = fat.lay_out(64 * MIB // 512, 65929216 - 65536).log_sectors * 512
    for size in (512, 1025, most + 512):
        with pytest.raises(FileError, match=rf"{size} bytes: .* to {most} fits"):
            fat.lay_out(64 * MIB // 512, size)


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


@pytest.mark.parametrize("size", [*SIZES, 64 * GIB])
def test_fsck_finds_nothing_to_mend(tmp_path: Path, size: int) -> None:
    fsck = program("fsck.fat", "dosfstools")
    whole = prepared(tmp_path / "card.img", size)
    part = partition_of(whole, tmp_path / "part.img")
    done = subprocess.run(
        [fsck, "-n", str(part)], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    first, last = done.stdout.splitlines()
    assert first.startswith("fsck.fat")
    assert re.search(r": 2 files, \d+/\d+ clusters$", last)


def test_mtools_copy_the_log_and_find_the_label(tmp_path: Path) -> None:
    mcopy, mlabel = program("mcopy", "mtools"), program("mlabel", "mtools")
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    image = f"{path}@@{Volume(path).start * 512}"
    copy = tmp_path / "PROBE.LOG"
    subprocess.run([mcopy, "-i", image, "::PROBE.LOG", str(copy)], check=True)
    label = subprocess.check_output([mlabel, "-s", "-i", image, "::"], text=True)
    assert "IMU-PROBE" in label
    assert copy.read_bytes() == log_of(path)


def test_sfdisk_finds_one_partition_to_the_end(tmp_path: Path) -> None:
    sfdisk = program("sfdisk", "fdisk")
    path = prepared(tmp_path / "card.img", 4 * GIB)
    done = json.loads(subprocess.check_output([sfdisk, "--json", str(path)]))
    (partition,) = done["partitiontable"]["partitions"]
    assert (partition["start"], partition["type"]) == (8192, "c")
    assert partition["size"] == 4 * GIB // 512 - 8192


# A writer of blocks of its own.


def sealed(block: bytes) -> bytes:
    return block + struct.pack("<I", zlib.crc32(block))


def block_of(
    card_id: int, number: int, recording: int, flags: int, payload: bytes
) -> bytes:
    head = struct.pack("<IIHBB", card_id, number, recording, flags, 0)
    return sealed(head + payload.ljust(496, b"\0"))


@dataclass
class Said:
    """One message of a recording: its content and the blocks that hold its frame,
    but for the zero at its end, for which any other will do."""

    content: bytes
    blocks: range


@dataclass
class Taped:
    """A recording as a probe writes it: payloads of blocks and what is in them."""

    payloads: list[bytes]
    said: list[Said]
    is_ended: bool = True


def tape(
    contents: list[bytes], *, flushed: set[int] | None = None, is_ended: bool = True
) -> Taped:
    """Frames run on over blocks; after those of `flushed` comes the next block."""
    payloads = [b""]
    said = []
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
        said.append(Said(content, range(first, end)))
        if index in (flushed or set()) and index < len(contents) - 1:
            payloads.append(b"")
    return Taped(payloads, said, is_ended)


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


def test_what_a_probe_wrote_comes_back_message_by_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probe = FakeProbe(board="f405")
    contents = contents_of(probe, 3000)
    path = with_log(prepared(tmp_path / "card.img"), laid([tape(contents)]))
    capsys.readouterr()
    assert run("read", path, "--to", tmp_path / "logs") == 0
    card_id = place_of(path)[2]
    (log,) = (tmp_path / "logs").iterdir()
    assert log.name == f"card-{card_id:08x}-{probe.name}-1.mcap"
    assert frames_of(log) == contents
    first, second, third = lines_of(capsys)
    written = len(tape(contents).payloads)
    blocks = place_of(path)[1] // 512 - 1
    assert first == (
        f"card {card_id:08x}: 1 recording, {written} of {blocks} blocks written, "
        "0 torn or worn"
    )
    assert second == (
        f"recording 1: probe {probe.name}, 0:00:15.0, 1125 raw, 1125 pose, "
        f"3001 sent = 3001 received + 0 skewed + 0 lost, ended cleanly: {log}"
    )
    assert third.startswith("times are the device's, from 1970 on; --started UTC")


def test_a_log_of_a_card_is_the_live_log_of_the_same_messages(tmp_path: Path) -> None:
    contents = contents_of(FakeProbe(), 200)
    path = bare(tmp_path, laid([tape(contents)], 0x1234))
    assert run("read", path, "--to", tmp_path / "card") == 0
    # As the daemon does it.
    sink = LogSink(tmp_path / "live")
    sink.open()
    probe = Probe(FakeProbe().name)
    session = Session(lambda _: probe, 0)
    for event in session.receive(b"".join(map(encode_frame, contents)), 0):
        if isinstance(event, Received):
            t_ns = event.stamp.t_device_us * 1000
            stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
            sink.take(
                record_of(
                    *(event.message, event.content, probe.probe_id, stamp),
                    *(probe.hello, probe.hello_content),
                )
            )
    sink.close()

    def told(folder: Path) -> tuple[list[Any], list[Any]]:
        (log,) = folder.iterdir()
        with log.open("rb") as file:
            reader = make_reader(file)
            records = [
                (
                    *(channel.topic, channel.message_encoding, spec and spec.name),
                    *(spec and spec.data, message.data, message.log_time),
                    *(message.publish_time, message.sequence),
                )
                for spec, channel, message in reader.iter_messages()
            ]
            metadata = [(each.name, each.metadata) for each in reader.iter_metadata()]
        return records, metadata

    live, card_made = told(tmp_path / "live"), told(tmp_path / "card")
    # Raw and pose are there as JSON, too, and 75 poses as Foxglove draws them.
    assert len(live[0]) == len(contents) + 150 + 75
    assert card_made == live


def test_several_probes_on_one_card_are_a_log_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    probes = [FakeProbe(), FakeProbe(probe_id=bytes(range(8)), boot_count=9)]
    probes.append(probes[0])
    tapes = [tape(contents_of(p, 30 + 10 * n)) for n, p in enumerate(probes)]
    path = with_log(prepared(tmp_path / "card.img"), laid(tapes))
    run("read", path, "--to", tmp_path)
    logs = logs_in(tmp_path)
    for number, (probe, each) in enumerate(zip(probes, tapes, strict=True), 1):
        assert probe.name in logs[number].name
        assert frames_of(logs[number]) == [said.content for said in each.said]
    capsys.readouterr()
    assert run("list", path) == 0
    rows = [re.split(r"  +", line) for line in lines_of(capsys)[1:]]
    assert rows == [
        ["recording", "probe", "duration", "samples", "lost", "bad", "end"],
        *(
            [
                *(str(n), p.name, f"0:00:{len(t.said[1:]) * 0.005:04.1f}"),
                str(sum(decode(said.content).name == "raw" for said in t.said)),
                *(f"0 of {len(t.said)}", "0 blocks", "ended cleanly"),
            ]
            for n, (p, t) in enumerate(zip(probes, tapes, strict=True), 1)
        ),
    ]


def test_one_recording_can_be_read_alone_and_dated(tmp_path: Path) -> None:
    late = FakeProbe()
    late.time_us = 4_294_900_000  # a wrap of device time is in the recording
    path = bare(tmp_path, blocks_of([FakeProbe(), late], 0x1234))
    began = "2026-01-02T03:04:05.5Z"
    to = tmp_path / "logs"
    assert run("read", path, "--to", to, "--recording", 2, "--started", began) == 0
    assert list(logs_in(to)) == [2]
    times = [i.t_ns for i in read_log(logs_in(to)[2]) if isinstance(i, Logged)]
    times = [t_ns for t_ns in times if t_ns]  # metadata has none
    began_ns = 1767323045_500_000_000
    assert min(times) == began_ns
    assert max(times) == began_ns + 40 * 5_000_000


def test_what_was_read_before_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tapes = [tape(contents_of(FakeProbe())) for _ in range(2)]
    run("read", bare(tmp_path, laid(tapes[:1], 0x1234)), "--to", tmp_path)
    before = logs_in(tmp_path)[1]
    before.write_bytes(b"mine")
    run("read", bare(tmp_path, laid(tapes, 0x1234)), "--to", tmp_path)
    assert before.read_bytes() == b"mine"
    assert frames_of(logs_in(tmp_path)[2]) == [said.content for said in tapes[1].said]
    assert f"recording 1: {before} is there already" in lines_of(capsys)


def test_decode_tells_of_a_card_and_of_its_logs_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bare(tmp_path, blocks_of([FakeProbe(), FakeProbe()], 0x1234))
    run("read", path, "--to", tmp_path)
    capsys.readouterr()

    def decoded(file: Path) -> tuple[list[dict[str, Any]], str]:
        assert cli.main(["decode", str(file), "--json"]) == 0
        captured = capsys.readouterr()
        items = [json.loads(line) for line in captured.out.splitlines()]
        return [item | {"t_ns": None, "age_us": None} for item in items], captured.err

    whole, told = decoded(path)
    logs = logs_in(tmp_path)
    assert whole == decoded(logs[1])[0] + decoded(logs[2])[0]
    assert len(whole) == 82
    name = FakeProbe().name
    for number in (1, 2):
        assert (
            f"recording {number} of {name}: 41 sent = 41 received + 0 skewed + 0 lost"
            in told
        )


def test_the_reader_in_the_docs_reads_it_too(tmp_path: Path, root: Path) -> None:
    (script,) = re.findall(
        r"```python\n(.*?)```", (root / "docs" / "card.md").read_text(), re.DOTALL
    )
    tapes = [tape(contents_of(FakeProbe(), count)) for count in (90, 60)]
    bare(tmp_path, laid(tapes, 0x1234))
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True)
    for number, each in enumerate(tapes, 1):
        data = (tmp_path / f"recording-{number}.bin").read_bytes()
        assert FrameDecoder().feed(data) == [said.content for said in each.said]


# What a card goes through.

kinds = st.sampled_from(["torn", "rubbish", "stale", "zero"])
damage = st.lists(st.tuples(st.integers(0, 400), kinds), max_size=6)


def hurt(blocks: list[bytes], damages: list[tuple[int, str]]) -> set[int]:
    """Damages blocks in place; which of them are bad after it."""
    bad = set()
    for place, kind in damages:
        index = place % len(blocks)
        block = blocks[index]
        if kind == "torn":  # the power went while it was written
            block = block[: place % 512] + b"\xff" * (512 - place % 512)
        elif kind == "rubbish":
            block = bytes((byte * 7 + place) & 0xFF for byte in block)
        elif kind == "stale":  # of this place, from before the card was prepared anew
            head = (0x777).to_bytes(4, "little")
            block = sealed(head + block[4:508])
        else:
            block = bytes(512)
        if block != blocks[index]:
            blocks[index] = block
            bad.add(index)
    return bad


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    counts=st.lists(st.integers(0, 120), min_size=1, max_size=4),
    flushed=st.sets(st.integers(0, 120), max_size=10),
    damages=damage,
    is_cut=st.booleans(),
    cut=st.integers(0, 40),
    behind=st.sampled_from(["nothing", "stale", "rubbish"]),
)
def test_all_but_the_damaged_blocks_comes_back_message_by_message(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    counts: list[int],
    flushed: set[int],
    damages: list[tuple[int, str]],
    is_cut: bool,
    cut: int,
    behind: str,
) -> None:
    probe = FakeProbe()
    tapes = [tape(contents_of(probe, count), flushed=flushed) for count in counts]
    blocks = laid(tapes, 0x1234)
    starts = [0]
    for each in tapes:
        starts.append(starts[-1] + len(each.payloads))
    bad = hurt(blocks, damages)
    if is_cut:
        kept = max(0, len(blocks) - cut)
        bad |= set(range(kept, len(blocks)))
        blocks[kept:] = [bytes(512)] * (len(blocks) - kept)
    if behind == "stale":
        blocks += [
            block_of(0x777, len(blocks) + 1 + n, 3, 0, b"\x05old\0") for n in range(9)
        ]
    elif behind == "rubbish":
        blocks += [bytes([n % 251 for n in range(k, k + 512)]) for k in range(9)]
    folder = tmp_path / "logs"
    shutil.rmtree(folder, ignore_errors=True)
    assert run("read", bare(tmp_path, blocks), "--to", folder) == 0
    logs = logs_in(folder)
    lines = lines_of(capsys)
    for number, (start, each) in enumerate(zip(starts, tapes, strict=False), 1):
        kept_said = [
            said
            for said in each.said
            if not any(start + block in bad for block in said.blocks)
        ]
        if not kept_said:
            assert number not in logs
            continue
        assert frames_of(logs[number]) == [said.content for said in kept_said]
        first, last = (decode(kept_said[index].content).sequence for index in (0, -1))
        assert first is not None
        assert last is not None
        (line,) = [each for each in lines if each.startswith(f"recording {number}: ")]
        # Each number up to the last that came is received or lost.
        assert (
            f"{last + 1} sent = {len(kept_said)} received + 0 skewed + "
            f"{last + 1 - len(kept_said)} lost" in line
        )
        has_last = starts[number] - 1 not in bad
        assert ("ended cleanly" if has_last else "cut off") in line
        assert ("its first block is lost" in line) is (start in bad)


def test_a_place_that_was_cut_and_written_again_belongs_to_who_wrote_it(
    tmp_path: Path,
) -> None:
    """A cut spoilt block 5 of a run; the next recording goes on there, and what the
    card had written behind it is still the first one's."""
    first, second = (contents_of(FakeProbe(), count) for count in (120, 20))
    old = laid([tape(first, is_ended=False)], 0x1234)
    new = laid([Taped([b""] * 4, []), tape(second)], 0x1234)[4:]
    assert len(new) < len(old) - 4
    path = bare(tmp_path, old[:4] + new + old[4 + len(new) :])
    run("read", path, "--to", tmp_path)
    logs = logs_in(tmp_path)
    assert frames_of(logs[2]) == second
    gone = range(4, 4 + len(new))
    assert frames_of(logs[1]) == [
        said.content
        for said in tape(first).said
        if not any(block in gone for block in said.blocks)
    ]


def test_a_block_that_was_written_twice_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A card says that it failed and has kept the block: its bytes come again."""
    each = tape(contents_of(FakeProbe(), 300))
    each.payloads.insert(10, each.payloads[10])
    path = bare(tmp_path, laid([each], 0x1234))
    run("list", path)
    assert re.split(r"  +", lines_of(capsys)[2])[4] == "0 of 301"
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [said.content for said in each.said]
    told = lines_of(capsys)[1]
    assert "301 sent = 301 received + 0 skewed + 0 lost" in told
    assert re.search(r", \d+ duplicated, 1 frame torn, ended cleanly", told)


def test_worn_places_are_stepped_over_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = blocks_of([FakeProbe()], 0x1234, 1500)
    for index in (*range(10, 18), 30, *range(40, 60)):
        blocks[index] = b"\xa5" * 512
    run("list", bare(tmp_path, blocks))
    summary, _, row = lines_of(capsys)
    assert summary.endswith(", 29 torn or worn")
    assert row.split("  ")[-2:] == ["29 blocks", "ended cleanly"]


def test_a_card_prepared_anew_shows_nothing_of_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    before = log_of(path)
    assert run("prepare", path, "--yes") == 0
    # The blocks are all still there: what makes them no good is the card's id alone.
    assert log_of(path)[512:] == before[512:]
    assert any(before[512:])
    capsys.readouterr()
    assert run("list", path) == 0
    (line,) = lines_of(capsys)
    assert ": 0 recordings, 0 of " in line
    assert run("read", path, "--to", tmp_path) == 0
    assert logs_in(tmp_path) == {}


def test_a_place_that_can_not_be_read_costs_that_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    each = tape(contents_of(FakeProbe(), 800))
    path = bare(tmp_path, laid([each], 0x1234))
    unreadable = (11, 12, 40)
    real = Disk.read_at

    def read_at(self: Disk, offset: int, size: int) -> bytes:
        if any(offset < (n + 1) * 512 and n * 512 < offset + size for n in unreadable):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return real(self, offset, size)

    monkeypatch.setattr(Disk, "read_at", read_at)
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [
        said.content
        for said in each.said
        if not any(block + 1 in unreadable for block in said.blocks)
    ]


def test_a_copy_that_was_cut_short_gives_what_it_has(tmp_path: Path) -> None:
    each = tape(contents_of(FakeProbe(), 400))
    path = bare(tmp_path, laid([each], 0x1234))
    os.truncate(path, 20 * 512 + 100)
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [
        said.content for said in each.said if said.blocks.stop <= 19
    ]


def test_a_file_moved_by_a_computer_is_not_read_as_if_it_were_in_one_piece(
    tmp_path: Path,
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    volume = Volume(path)
    first = volume.entries()[b"PROBE   LOG"][1]
    entry = (volume.start + volume.reserved) * 512 + (first + 3) * 4
    with path.open("r+b") as file:
        file.seek(entry)
        file.write((first + 7).to_bytes(4, "little"))
    with disk.opened(path) as image, pytest.raises(FileError, match="in one piece"):
        card.find_log(image)


def test_a_bare_partition_is_read_as_well(tmp_path: Path) -> None:
    whole = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    part = partition_of(whole, tmp_path / "part.img")
    assert run("read", part, "--to", tmp_path) == 0
    assert len(frames_of(logs_in(tmp_path)[1])) == 41


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    flips=st.lists(
        st.tuples(st.integers(0, 700 * 512), st.integers(0, 255)),
        min_size=1,
        max_size=30,
    )
)
def test_a_damaged_file_system_is_one_clear_line(
    tmp_path: Path, flips: list[tuple[int, int]]
) -> None:
    pristine = tmp_path / "pristine.img"
    if not pristine.exists():
        prepared(pristine, SMALL)
    path = tmp_path / "card.img"
    shutil.copyfile(pristine, path)
    with path.open("r+b") as file:
        for place, byte in flips:
            # Mostly where it hurts: table, boot sector, folder.
            volume = (0, 128 * 512, 128 * 512 + 1152 * 512)[place % 3]
            file.seek(volume + place // 3 % 512)
            file.write(bytes([byte]))
    with disk.opened(path) as image:
        try:
            log = card.find_log(image)
        except FileError as error:
            assert "\n" not in str(error)
        else:
            assert log.recordings() == []


# Errors, each a line.


def error_of(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert run(*arguments) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("imud: ")
    assert captured.err.count("\n") == 1
    return captured.err[6:-1]


def test_what_can_not_be_prepared_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "small.img"
    assert error_of(capsys, "prepare", small, "--size", SMALL - 2**19) == (
        f"{small}: {SMALL - 2**19} bytes are too small: FAT32 needs {SMALL} (34 MiB)"
    )
    assert not small.exists()
    assert error_of(capsys, "prepare", small) == (
        f"{small} is not there; --size BYTES makes an image"
    )
    assert error_of(capsys, "prepare", "/dev/nothing") == (
        "can't look at /dev/nothing: No such file or directory; put the card in, and "
        "look for its name with lsblk"
    )
    for place in ("/dev/null", tmp_path):
        assert error_of(capsys, "prepare", place) == (
            f"{place} is neither a card nor a file"
        )
    small.write_bytes(b"a letter")
    assert "too small" in error_of(capsys, "prepare", small, "--yes")
    assert error_of(capsys, "prepare", small, "--size", "64M") == (
        f"{small} is there; --size is for an image that is not"
    )
    assert small.read_bytes() == b"a letter"
    assert "multiple of 512K" in error_of(
        capsys, "prepare", tmp_path / "odd.img", "--size", SMALL + 1
    )
    far = tmp_path / "no" / "card.img"
    assert error_of(capsys, "prepare", far, "--size", SMALL) == (
        f"can't write {far}: No such file or directory"
    )


@pytest.mark.parametrize("text", ["", "M", "8T", "-1", "1.5G", "0x200"])
def test_a_size_is_a_number(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run("prepare", "card.img", f"--size={text}")
    assert "is not a number of bytes" in capsys.readouterr().err


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_nothing_is_overwritten_without_a_yes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    capsys.readouterr()
    before = path.read_bytes()
    assert re.fullmatch(
        re.escape(str(path)) + r" \(35.7 MB, the log of a probe, 2.\d kB of it "
        r"written\) would be overwritten; say --yes",
        error_of(capsys, "prepare", path),
    )
    for answer in ("", "\n", "y\n", "no\n"):
        monkeypatch.setattr(sys, "stdin", Terminal(answer))
        assert run("prepare", path) == 1
        told = capsys.readouterr().err
        assert "has 35.7 MB and holds the log of a probe" in told
        assert told.endswith(f"imud: {path} was left as it is\n")
    assert path.read_bytes() == before
    monkeypatch.setattr(sys, "stdin", Terminal("yes\n"))
    assert run("prepare", path) == 0
    assert path.read_bytes() != before


def test_what_is_on_a_card_is_named(tmp_path: Path) -> None:
    path = tmp_path / "card.img"

    def named() -> str:
        return error_of_ask(path)

    prepared(path)
    assert "the empty log of a probe" in named()
    with path.open("r+b") as file:
        start = Volume(path).start * 512
        file.seek(start)
        boot = file.read(512)
        file.seek(start)
        file.write(bytes(512))
    assert "1 partition (type 0x0c)" in named()
    with path.open("r+b") as file:
        file.write(boot)
    assert "a FAT32 file system" in named()
    with path.open("r+b") as file:
        file.write(b"\x01" * 512)
    assert "something else" in named()
    path.write_bytes(b"")
    os.truncate(path, SMALL)
    assert "nothing at its start" in named()


def error_of_ask(path: Path) -> str:
    with pytest.raises(FileError, match="say --yes") as caught:
        card.prepare(path, size=None, log_size=None, is_agreed=False)
    return str(caught.value)


def test_a_card_that_does_not_keep_what_is_written_is_found_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "card.img"
    real = Disk.write

    def write(self: Disk, sector: int, data: bytes) -> None:
        if sector == 128:  # where the partition begins
            data = data[:-1] + b"\x01"
        real(self, sector, data)

    monkeypatch.setattr(Disk, "write", write)
    told = error_of(capsys, "prepare", path, "--size", SMALL)
    assert told.endswith(
        "does not keep what is written to it (sector 128); take another card"
    )
    assert not path.exists()


def test_a_preparation_that_is_cut_leaves_no_card_of_a_probe(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = prepared(tmp_path / "card.img")
    places: list[int] = []
    monkeypatch.setattr(Disk, "write", lambda _, sector, __: places.append(sector))
    monkeypatch.setattr(Disk, "read", lambda *_: b"")
    with pytest.raises(FileError, match="does not keep"):
        card.prepare(path, size=None, log_size=None, is_agreed=True)
    monkeypatch.undo()
    assert places[0] == places[-1] == 0
    for cut in range(1, len(places)):
        left = iter(range(cut))
        real = Disk.write

        def write(self: Disk, sector: int, data: bytes) -> None:
            if next(left, None) is None:  # noqa: B023 - used up within this turn
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            real(self, sector, data)  # noqa: B023 - the same in each turn

        with monkeypatch.context() as patch:
            patch.setattr(Disk, "write", write)
            told = error_of(capsys, "prepare", path, "--yes")
            assert told == f"can't write {path}: Input/output error"
        assert "is no card of a probe" in error_of(capsys, "list", path)
    assert run("prepare", path, "--yes") == 0


def test_what_can_not_be_read_is_told_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "some.file"
    assert error_of(capsys, "list", file) == (
        f"can't read {file}: No such file or directory"
    )
    assert error_of(capsys, "read", tmp_path) == (
        f"can't read {tmp_path}: Is a directory"
    )
    for data in (b"", b"a letter", bytes(4096), b"\x55\xaa" * 4096):
        file.write_bytes(data)
        assert error_of(capsys, "list", file).startswith(
            f"{file} is no card of a probe: "
        )
    head = struct.pack("<8sHHIII", b"IMUPROBE", 2, 512, 5, 8192, 100)
    file.write_bytes(sealed(head.ljust(508, b"\0")))
    assert "holds a log of version 2, this imud reads 1" in error_of(
        capsys, "list", file
    )
    file.write_bytes(head.ljust(512, b"\0"))
    assert "was not prepared for a probe" in error_of(capsys, "read", file)
    path = bare(tmp_path, blocks_of([FakeProbe(), FakeProbe()], 0x1234))
    assert error_of(capsys, "read", path, "--recording", 7) == (
        f"{path} has no recording 7; it has 1, 2"
    )
    assert error_of(capsys, "read", path, "--started", "2026-01-02") == (
        "--started is of one recording: say --recording N, too"
    )
    with pytest.raises(SystemExit, match="2"):
        run("read", path, "--started", "yesterday")


def test_a_full_disk_is_told_and_leaves_no_half_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bare(tmp_path, blocks_of([FakeProbe()], 0x1234, 400))
    to = tmp_path / "logs"
    to.mkdir()
    log = to / f"card-00001234-{FakeProbe().name}-1.mcap"
    (to / f"{log.name}.part").symlink_to("/dev/full")
    assert error_of(capsys, "read", path, "--to", to) == (
        f"can't write {log}: No space left on device; name another place with --to DIR"
    )
    assert list(to.iterdir()) == []
    (tmp_path / "file").touch()
    assert "name another place with --to DIR" in error_of(
        capsys, "read", path, "--to", tmp_path / "file"
    )


def test_a_recording_of_another_schema_is_named_and_the_others_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = FakeProbe(schema_fingerprint=0x12345678, firmware="9.9.9")
    path = bare(tmp_path, blocks_of([other, FakeProbe()], 0x1234))
    assert run("read", path, "--to", tmp_path) == 1
    captured = capsys.readouterr()
    assert (
        "recording 1: probe 00112233445566aa speaks schema 0x12345678" in captured.out
    )
    assert captured.err == f"imud: 1 recording of {path} can't be read\n"
    assert list(logs_in(tmp_path)) == [2]


def test_a_bar_is_shown_on_a_terminal_and_taken_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    run("read", path, "--to", tmp_path)
    drawn = screen.getvalue()
    for label in ("preparing", "looking", "reading"):
        assert f"{label} " in drawn
    assert drawn.endswith("\r\033[K")


# Disks.


@pytest.fixture
def kernel(tmp_path: Path) -> Iterator[Path]:
    """What Linux says of a card reader, /dev/sdb, with a card of two partitions."""
    sdb = tmp_path / "devices" / "usb1" / "sdb"
    blocks = tmp_path / "blocks"
    blocks.mkdir()
    for folder, number in (
        (sdb, "8:16"),
        (sdb / "sdb1", "8:17"),
        (sdb / "sdb2", "8:18"),
    ):
        folder.mkdir(parents=True)
        (folder / "holders").mkdir()
        (folder / "dev").write_text(f"{number}\n")
        (blocks / number).symlink_to(folder)
    for part in ("sdb1", "sdb2"):
        (sdb / part / "partition").write_text("1\n")
    for name, text in (("removable", "1"), ("ro", "0"), ("size", "62333952")):
        (sdb / name).write_text(f"{text}\n")
    yield sdb


def refusal(tmp_path: Path, number: str = "8:16", mounts: str = "") -> str:
    table = tmp_path / "mountinfo"
    table.write_text(mounts)
    try:
        disk.refuse_unless_card(Path("/dev/sdb"), number, tmp_path / "blocks", table)
    except FileError as error:
        return str(error)
    return ""


def mount(number: str, place: str) -> str:
    return f"36 35 {number} / {place} rw,noatime shared:1 - vfat /dev/x rw\n"


def test_a_card_in_a_reader_is_taken(tmp_path: Path, kernel: Path) -> None:
    others = mount("8:1", "/") + mount("0:22", "/proc")
    assert refusal(tmp_path, mounts=others) == ""
    (kernel / "removable").write_text("0\n")
    (kernel / "device").mkdir()
    (kernel / "device" / "type").write_text("SD\n")  # a reader of the board's own
    assert refusal(tmp_path) == ""


@pytest.mark.parametrize("number", ["8:16", "8:17", "8:18"])
def test_a_mounted_card_is_refused(tmp_path: Path, kernel: Path, number: str) -> None:
    assert kernel.is_dir()
    mounts = mount("8:1", "/") + mount(number, "/media/a\\040card")
    assert refusal(tmp_path, mounts=mounts) == (
        "/dev/sdb is mounted at /media/a card; umount /media/a card"
    )
    assert refusal(tmp_path, mounts=mount(number, "/")) == (
        "/dev/sdb is the disk this computer runs from"
    )


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("removable", "0", "/dev/sdb is not a card: it can't be taken out"),
        ("ro", "1", "/dev/sdb is read-only; slide the lock at the card's side"),
        ("size", "0", "no card is in /dev/sdb; put it in"),
        ("sdb2/holders/dm-0", "", "/dev/sdb is in use by dm-0"),
        ("partition", "1", "/dev/sdb is a partition; name the card itself: /dev/usb1"),
    ],
)
def test_a_disk_that_is_no_free_card_is_refused(
    tmp_path: Path, kernel: Path, name: str, text: str, told: str
) -> None:
    (kernel / name).write_text(f"{text}\n")
    assert refusal(tmp_path) == told


def test_a_partition_is_not_taken_for_a_card(tmp_path: Path, kernel: Path) -> None:
    assert kernel.is_dir()
    table = tmp_path / "mountinfo"
    table.write_text("")
    with pytest.raises(FileError, match=r"the card itself: /dev/sdb$"):
        disk.refuse_unless_card(Path("/dev/sdb1"), "8:17", tmp_path / "blocks", table)
    assert "cards are prepared under Linux" in refusal(tmp_path, "9:9")


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Path]:
    """A block device of the kernel's over a file."""
    losetup = program("losetup", "mount")
    image = tmp_path / "loop.img"
    with image.open("wb") as file:
        file.truncate(64 * MIB)
    command = [losetup, "--find", "--show", str(image)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        # Containers and plain users have none: no code of ours can make one. What a
        # device is refused for is tested on made-up tables of the kernel above.
        pytest.skip("no loop device can be set up here: it takes root")
    device = Path(done.stdout.strip())
    yield device
    subprocess.run([losetup, "--detach", str(device)], check=True)


def test_a_block_device_is_prepared_and_read(
    tmp_path: Path, loop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "(67.1 MB, nothing at its start)" in error_of(capsys, "prepare", loop)
    descriptor = os.open(loop, os.O_RDONLY | os.O_EXCL)  # as a mount holds it
    assert error_of(capsys, "prepare", loop, "--yes") == (
        f"{loop} is in use; unmount all of it first"
    )
    os.close(descriptor)
    assert run("prepare", loop, "--yes") == 0
    each = tape(contents_of(FakeProbe(), 500))
    with_log(loop, laid([each]))
    assert run("read", loop, "--to", tmp_path) == 0
    assert frames_of(logs_in(tmp_path)[1]) == [said.content for said in each.said]
