# SPDX-License-Identifier: MIT
"""Lays out a card with one FAT32 partition that holds one contiguous file, makes its
sectors, and finds that file again. After Microsoft's FAT32 File System Specification
1.03 ("FAT" below), whose names the comments use. No I/O: bytes in, bytes out.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from imud.errors import FileError

SECTOR = 512

# Sectors of a cluster, the largest first: a probe follows the file's chain at each
# start. Not all systems read more than 32 KB (FAT, BPB_SecPerClus).
_CLUSTERS = (64, 32, 16, 8, 4, 2, 1)

# Fewer clusters make it a FAT16, and one should stay 16 away from that (FAT, "FAT Type
# Determination").
_CLUSTERS_MIN = 65525 + 16

# The most sectors that a card erases at once: "boundary unit" of the SD Association,
# for cards up to 2 GB and for larger ones. Partition, data and log begin on a multiple.
_UNIT_SMALL, _UNIT_LARGE = 128, 8192
_LARGE = 2 << 30

# The smallest card that has enough clusters then.
CARD_MIN = 34 << 20

# Sector numbers have 32 bits in the partition table, in FAT32 and on the bus.
_SECTORS_MAX = 2**32 - 1

# A file's length has 32 bits (DIR_FileSize). fsck.fat 4.2 holds the length of its
# clusters in 32 bits, too: it takes 4 GiB for 0 and would truncate the file.
_FILE_MAX = 2**32

# Sectors left free behind the log for files that computers drop on a card: 1 MiB.
_SPARE = 2048

_RESERVED_MIN = 32  # FAT, BPB_RsvdSecCnt
_FAT_COUNT = 2
_ROOT = 2  # BPB_RootClus
_INFO, _BACKUP = 1, 6  # BPB_FSInfo, BPB_BkBootSec
_END_OF_CHAIN = 0x0FFFFFFF
_CLUSTER_MASK = 0x0FFFFFFF  # a FAT32 entry has 28 bits

_TYPES = (0x0B, 0x0C)  # of a FAT32 partition in the table
_SIGNATURE = b"\x55\xaa"
_LABEL = b"IMU-PROBE  "
_NAME = b"PROBE   LOG"
_READ_ONLY, _VOLUME, _ARCHIVE = 0x01, 0x08, 0x20  # DIR_Attr
_FOLDER = 0x10

# From BS_jmpBoot to BS_FilSysType.
_BOOT = struct.Struct("<3s8sHBHBHHBHHHIIIHHIHH12sBBBI11s8s")
_ENTRY = struct.Struct("<11sBBBHHHHHHHI")  # a directory entry
_PARTITION = struct.Struct("<B3sB3sII")
_PARTITIONS = 446  # where the table is in its sector
_CHUNK = 2048  # sectors written or read at once: 1 MiB

# A chain of the root folder with more clusters than this is a loop.
_ROOT_MAX = 65536


@dataclass(frozen=True, slots=True)
class Layout:
    """Where things are, in sectors from the start of the card."""

    sectors: int  # of the card
    start: int  # of the partition
    cluster: int  # sectors of one
    reserved: int  # from `start` to the first FAT
    fat: int  # sectors of one FAT
    clusters: int
    log_cluster: int
    log_sectors: int

    @property
    def data(self) -> int:
        """Where the clusters begin."""
        return self.start + self.reserved + _FAT_COUNT * self.fat

    @property
    def log(self) -> int:
        return self.data + (self.log_cluster - _ROOT) * self.cluster

    @property
    def log_clusters(self) -> int:
        return -(-self.log_sectors // self.cluster)


def lay_out(sectors: int, log_bytes: int | None = None) -> Layout:
    """The layout of a card; `log_bytes` None: all that fits. FileError otherwise."""
    if sectors * SECTOR < CARD_MIN:
        raise FileError(
            f"{sectors * SECTOR} bytes are too small: FAT32 needs {CARD_MIN} (34 MiB)"
        )
    sectors = min(sectors, _SECTORS_MAX)
    unit = _UNIT_SMALL if sectors * SECTOR <= _LARGE else _UNIT_LARGE
    size = sectors - unit
    for cluster in _CLUSTERS:
        # Counted for all sectors, these are a few entries too many, which is allowed.
        fat = -(-(size // cluster + _ROOT) * 4 // SECTOR)
        before = _RESERVED_MIN + _FAT_COUNT * fat
        reserved = _RESERVED_MIN + -before % unit
        clusters = (size - reserved - _FAT_COUNT * fat) // cluster
        if clusters >= _CLUSTERS_MIN:
            break
    log_cluster = _ROOT + unit // cluster
    room = (clusters + _ROOT - log_cluster) * cluster
    most = _FILE_MAX // SECTOR - cluster
    if log_bytes is None:
        log_sectors = min((room - _SPARE) // cluster * cluster, most)
    else:
        log_sectors, rest = divmod(log_bytes, SECTOR)
        most = min(room, most)
        if rest or not 2 <= log_sectors <= most:
            raise FileError(
                f"a log can't have {log_bytes} bytes: a multiple of {SECTOR} from "
                f"{2 * SECTOR} to {most * SECTOR} fits on this card"
            )
    return Layout(
        *(sectors, unit, cluster, reserved, fat, clusters),
        *(log_cluster, log_sectors),
    )


def partition_table(layout: Layout, identity: int) -> bytes:
    """The first sector: one partition from `start` to the end of the card."""
    # Cylinder, head and sector: the value for "too far". Type 0x0C means: use the LBA.
    far = b"\xfe\xff\xff"
    size = layout.sectors - layout.start
    entry = _PARTITION.pack(0, far, _TYPES[1], far, layout.start, size)
    head = struct.pack("<440xI2x", identity)
    return (head + entry).ljust(510, b"\0") + _SIGNATURE


def sectors_before_log(
    layout: Layout, identity: int, now: time.struct_time
) -> Iterator[tuple[int, bytes]]:
    """Everything from sector 1 to the log, as (first sector, bytes), in order.

    It overwrites all that was there: traces of another file system could mislead a
    computer.
    """
    yield from _zeros(1, layout.start)
    boot = _boot_sector(layout, identity)
    info = _info_sector(layout)
    reserved = bytearray(layout.reserved * SECTOR)
    for place, sector in ((0, boot), (_INFO, info)):
        for copy in (place, place + _BACKUP):
            reserved[copy * SECTOR : (copy + 1) * SECTOR] = sector
    yield layout.start, bytes(reserved)
    for number in range(_FAT_COUNT):
        first = layout.start + layout.reserved + number * layout.fat
        for at in range(0, layout.fat, _CHUNK):
            yield first + at, _fat(layout, at, min(at + _CHUNK, layout.fat))
    root = _folder(layout, now).ljust(layout.cluster * SECTOR, b"\0")
    yield layout.data, root
    yield from _zeros(layout.data + layout.cluster, layout.log)


def _zeros(first: int, end: int) -> Iterator[tuple[int, bytes]]:
    for at in range(first, end, _CHUNK):
        yield at, bytes(SECTOR * min(_CHUNK, end - at))


def _boot_sector(layout: Layout, identity: int) -> bytes:
    # A computer that boots from the card jumps to this halt.
    halt = b"\xf4\xeb\xfd"
    return (
        _BOOT.pack(
            *(b"\xeb\x58\x90", b"MSWIN4.1", SECTOR, layout.cluster, layout.reserved),
            *(_FAT_COUNT, 0, 0, 0xF8, 0, 63, 255, layout.start),
            *(layout.sectors - layout.start, layout.fat, 0, 0, _ROOT, _INFO, _BACKUP),
            *(b"", 0x80, 0, 0x29, identity, _LABEL, b"FAT32   "),
        )
        + halt
    ).ljust(510, b"\0") + _SIGNATURE


def _info_sector(layout: Layout) -> bytes:
    free = layout.clusters - 1 - layout.log_clusters
    head = struct.pack("<4s480x4sII", b"RRaA", b"rrAa", free, _ROOT + 1)
    return head.ljust(510, b"\0") + _SIGNATURE


def _fat(layout: Layout, begin: int, end: int) -> bytes:
    """Sectors `begin` to `end` of a FAT."""
    per_sector = SECTOR // 4
    first = begin * per_sector
    number = np.arange(first, end * per_sector, dtype=np.uint32)
    last = layout.log_cluster + layout.log_clusters - 1
    is_log = (number >= layout.log_cluster) & (number < last)
    entries = np.where(is_log, number + 1, 0).astype("<u4")
    # FAT[0] holds the media, FAT[1] "cleanly unmounted"; the other two end chains.
    fixed = {0: 0x0FFFFFF8, 1: _END_OF_CHAIN, _ROOT: _END_OF_CHAIN, last: _END_OF_CHAIN}
    for cluster, value in fixed.items():
        if first <= cluster < end * per_sector:
            entries[cluster - first] = value
    return entries.tobytes()


def _folder(layout: Layout, now: time.struct_time) -> bytes:
    date = (max(now.tm_year, 1980) - 1980) << 9 | now.tm_mon << 5 | now.tm_mday
    clock = now.tm_hour << 11 | now.tm_min << 5 | now.tm_sec // 2
    when = (0, 0, clock, date, date)  # NTRes, tenths, created, last looked at
    label = _ENTRY.pack(_LABEL, _VOLUME, 0, 0, 0, 0, 0, 0, clock, date, 0, 0)
    high, low = divmod(layout.log_cluster, 1 << 16)
    # Read-only, so that no computer edits or moves it: the probe relies on its place.
    log = _ENTRY.pack(
        *(_NAME, _ARCHIVE | _READ_ONLY, *when, high, clock, date, low),
        layout.log_sectors * SECTOR,
    )
    return label + log


@dataclass(frozen=True, slots=True)
class LogExtent:
    """The log's file on a card, in bytes from its start."""

    offset: int
    size: int


class NoLog(Exception):
    """Why the log's file can't be found. Never leaves the package."""


def is_boot_sector(sector: bytes) -> bool:
    """Whether it is the first sector of a FAT32."""
    return sector[82:90] == b"FAT32   " and sector[510:512] == _SIGNATURE


def partition_types(sector: bytes) -> list[int]:
    """The type of each partition in a partition table; empty if it is no table."""
    if sector[510:512] != _SIGNATURE:
        return []
    entries = _PARTITION.iter_unpack(sector[_PARTITIONS:510])
    return [entry[2] for entry in entries if entry[2]]


def find_log(read: Callable[[int, int], bytes]) -> LogExtent:
    """Finds PROBE.LOG on a card or partition; NoLog if it isn't there in one piece.

    `read(first, count)` gives sectors.
    """
    return _Volume(read).find()


class _Volume:
    def __init__(self, read: Callable[[int, int], bytes]) -> None:
        self._read = read
        self._start = self._partition()
        boot = self._sectors(self._start, 1)
        if not is_boot_sector(boot):
            raise NoLog("its FAT32 partition has no boot sector")
        fields = _BOOT.unpack_from(boot)
        size, self._cluster, reserved, fats = fields[2:6]
        self._fat, self._root = fields[14], fields[17]
        if size != SECTOR or 0 in (self._cluster, fats) or self._root < _ROOT:
            raise NoLog("its FAT32 is not of a card")
        self._fats = self._start + reserved
        self._data = self._fats + fats * self._fat

    def find(self) -> LogExtent:
        cluster = self._root
        for _ in range(_ROOT_MAX):
            folder = self._sectors(self._at(cluster), self._cluster)
            for entry in _ENTRY.iter_unpack(folder):
                if entry[0][0] == 0:  # no more
                    raise NoLog("it has no PROBE.LOG")
                if entry[0] == _NAME and not entry[1] & (_VOLUME | _FOLDER):
                    return self._file(entry[7] << 16 | entry[10], entry[11])
            cluster = self._next(cluster)
            if not _ROOT <= cluster < _ROOT + self._fat * SECTOR // 4:
                raise NoLog("it has no PROBE.LOG")
        raise NoLog("its folder's cluster chain is a loop")

    def _file(self, cluster: int, size: int) -> LogExtent:
        count = -(-size // (self._cluster * SECTOR))
        if count == 0 or cluster < _ROOT:
            raise NoLog("its PROBE.LOG is empty")
        number = cluster * 4 // SECTOR
        end = -(-(cluster + count) * 4 // SECTOR)
        chain = b"".join(
            self._sectors(self._fats + at, min(_CHUNK, end - at))
            for at in range(number, end, _CHUNK)
        )
        first = cluster - number * SECTOR // 4
        links = np.frombuffer(chain, "<u4")[first : first + count - 1] & _CLUSTER_MASK
        if np.any(links != np.arange(cluster + 1, cluster + count)):
            raise NoLog(
                "its PROBE.LOG is fragmented; copy it from the card and read the copy"
            )
        return LogExtent(self._at(cluster) * SECTOR, size)

    def _partition(self) -> int:
        sector = self._sectors(0, 1)
        if is_boot_sector(sector):
            return 0
        if sector[510:512] == _SIGNATURE:
            entries = _PARTITION.iter_unpack(sector[_PARTITIONS:510])
            for _, _, kind, _, start, size in entries:
                if kind in _TYPES and size:
                    return int(start)
        raise NoLog("it has no FAT32 partition")

    def _next(self, cluster: int) -> int:
        sector, place = divmod(cluster * 4, SECTOR)
        data = self._sectors(self._fats + sector, 1)
        return int.from_bytes(data[place : place + 4], "little") & _CLUSTER_MASK

    def _at(self, cluster: int) -> int:
        return int(self._data + (cluster - _ROOT) * self._cluster)

    def _sectors(self, first: int, count: int) -> bytes:
        data = self._read(first, count)
        if len(data) < count * SECTOR:
            raise NoLog("it is shorter than its file system")
        return data
