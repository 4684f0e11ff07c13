# SPDX-License-Identifier: MIT
"""`imud card prepare` makes a FAT32 with one file that other systems read."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from card_files import (
    MIB,
    SMALL,
    blocks_of,
    log_of,
    partition_of,
    place_of,
    prepared,
    program,
    run,
    start_of,
    with_log,
)
from fakes import FakeProbe
from imud.card import fat
from imud.errors import FileError
from programs import ran

pytestmark = pytest.mark.sampled(2)

GIB = 1 << 30
SIZES = [
    SMALL,
    *(n * MIB for n in (64, 260, 261, 1024, 2048, 4096, 8192, 32768, 65536)),
]


@pytest.mark.parametrize("size", SIZES)
def test_a_prepared_card_is_a_fat32_with_one_file_in_one_piece(
    tmp_path: Path, size: int
) -> None:
    """For fsck.fat, which finds nothing to mend, and mtools."""
    path = prepared(tmp_path / "card.img", size)
    assert path.stat().st_size == size
    part = partition_of(path, tmp_path / "part.img")
    fsck = program("fsck.fat", "dosfstools")
    command = [fsck, "-n", str(part)]
    done = ran(*command, check=True)
    assert done.stderr == ""
    first_line, last_line = done.stdout.splitlines()
    assert first_line.startswith("fsck.fat")
    counts = re.search(r": 2 files, (\d+)/(\d+) clusters$", last_line)
    used, clusters = map(int, counts.groups())
    # A FAT with fewer clusters is no FAT32, whatever it says of itself.
    assert clusters >= 65525
    told = mtool("minfo", part, "::")
    assert 'disk label="IMU-PROBE  "' in told
    start = number(told, "hidden sectors")
    assert start == start_of(path)
    assert (start + number(told, "big size")) * 512 == size
    cluster = number(told, "cluster size")
    data = start + number(told, r"reserved \(boot\) sectors")
    data += 2 * number(told, "Big fatlen")
    (piece,) = re.findall(r"<(\d+)-(\d+)>", mtool("mshowfat", part, "::PROBE.LOG"))
    first, last = map(int, piece)
    assert mtool("mattrib", part, "::PROBE.LOG").split() == ["A", "R", "::/PROBE.LOG"]
    lba = data + (first - 2) * cluster
    with path.open("rb") as file:
        file.seek(lba * 512)
        head = file.read(512)
    magic, version, block, card_id, place, blocks = struct.unpack_from("<8sHHIII", head)
    assert (magic, version, block) == (b"IMUPROBE", 1, 512)
    assert card_id > 0
    assert place == lba
    assert not any(head[24:508])
    assert int.from_bytes(head[508:], "little") == zlib.crc32(head[:508])
    assert last + 1 - first == -(-blocks // cluster)
    assert used == last + 1 - first + 1  # and the folder
    free = (clusters - used) * cluster * 512
    assert blocks * 512 == 4 * GIB - cluster * 512 or MIB <= free < 6 * MIB
    unit = 65536 if size <= 2 * GIB else 4 * MIB
    assert [n * 512 % unit for n in (start, data, lba)] == [0, 0, 0]


def mtool(name: str, part: Path, *words: str) -> str:
    command = [program(name, "mtools"), "-i", part, *words]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def number(told: str, name: str) -> int:
    """What minfo says of this."""
    found = re.search(rf"^{name}[:=] ?(\d+)", told, re.MULTILINE)
    assert found is not None, name
    return int(found[1])


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
    assert place_of(path)[1] == MIB
    most = fat.lay_out(64 * MIB // 512, 65929216 - 65536).log_sectors * 512
    for size in (512, 1025, most + 512):
        with pytest.raises(FileError, match=rf"{size} bytes: .* to {most} fits"):
            fat.lay_out(64 * MIB // 512, size)


def test_mtools_copy_the_log_and_find_the_label(tmp_path: Path) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    part, copy = partition_of(path, tmp_path / "part.img"), tmp_path / "PROBE.LOG"
    mtool("mcopy", part, "::PROBE.LOG", str(copy))
    assert "IMU-PROBE" in mtool("mlabel", part, "-s", "::")
    assert copy.read_bytes() == log_of(path)


def test_sfdisk_finds_one_partition_to_the_end(tmp_path: Path) -> None:
    sfdisk = program("sfdisk", "fdisk")
    path = prepared(tmp_path / "card.img", 4 * GIB)
    done = json.loads(subprocess.check_output([sfdisk, "--json", str(path)]))
    (partition,) = done["partitiontable"]["partitions"]
    assert (partition["start"], partition["type"]) == (8192, "c")
    assert partition["size"] == 4 * GIB // 512 - 8192
