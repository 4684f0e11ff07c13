# SPDX-License-Identifier: MIT
"""Shared by the tests of the log: a volume with the prepared file, a probe that logs
to it, and a host that reads it back."""

from __future__ import annotations

import zlib
from typing import Any

import native
from core.fake_card import BLOCK, FakeCard
from core.fake_spi import Wire

ffi, lib = native.load()

RING = 65536
FRAME = 118  # bytes: raw and pose of a sample
RATE_HZ = 380
SECOND = 1_000_000
LOST_US_MAX = 500_000

STATES = {
    getattr(lib, f"CARD_{name.upper()}"): name
    for name in (
        *("none", "absent", "starting", "unprepared"),
        *("ready", "logging", "full", "failed"),
    )
}
EVENTS = {
    getattr(lib, f"EVENT_{name.upper()}"): name
    for name in ("card_ready", "card_fault", "card_full", "log_started", "log_ended")
}
CAUSES = {
    getattr(lib, f"CAUSE_{name.upper()}"): name
    for name in (
        *("none", "command", "timeout", "late", "absent"),
        *("unprepared", "rejected", "worn", "full"),
    )
}


class Volume:
    """A card with a partition, a root folder and the file, all as small as can be."""

    def __init__(
        self,
        blocks: int = 400,
        *,
        cluster: int = 2,
        kind: int = 0x0C,
        entry: int = 0,
        others: int = 0,
        card_id: int = 0x1234ABCD,
        fat_blocks: int | None = None,
        reserved: int = 4,
    ) -> None:
        self.blocks, self.cluster, self.card_id = blocks, cluster, card_id
        self.start, self.reserved = 64, reserved
        roots = others // (16 * cluster) + 1
        file_clusters = -(-blocks // cluster)
        self.clusters = roots + file_clusters + 3
        self.fat_blocks = fat_blocks or (self.clusters + 2) // 128 + 1
        self.size = self.reserved + 2 * self.fat_blocks + self.clusters * cluster
        self.data = self.start + self.reserved + 2 * self.fat_blocks
        # The root's clusters lie behind the file but for the first.
        self.first = 3
        root = [2, *range(3 + file_clusters, 2 + roots + file_clusters)]
        self.file = self.block_of(self.first)
        self.links = [0x0FFFFFF8, 0x0FFFFFFF] + [0] * self.clusters
        for one, other in zip(root, [*root[1:], 0x0FFFFFFF], strict=True):
            self.links[one] = other
        for cluster_number in range(self.first, self.first + file_clusters):
            self.links[cluster_number] = cluster_number + 1
        self.links[self.first + file_clusters - 1] = 0x0FFFFFFF
        self.content: dict[int, bytes] = {}
        table = bytearray(BLOCK)
        at = 446 + 16 * entry
        table[at + 4] = kind
        table[at + 8 : at + 16] = words(self.start, self.size)
        table[510:] = b"\x55\xaa"
        self.content[0] = bytes(table)
        self.content[self.start] = self.boot()
        self.write_links()
        names = [
            *(b"IMU-PROBE  \x08", b"\xe5ROBE   LOG\x20", b"APROBE.LOG.\x0f"),
            *(f"FILE{i:04}TXT".encode() + b"\x20" for i in range(others)),
        ]
        entries = [name.ljust(32, b"\0") for name in names[-others or None :]]
        entries[-1:] = [*entries[-1:], self.entry()]
        self.root = root
        raw = b"".join(entries)
        for i, number in enumerate(root):
            for k in range(cluster):
                part = raw[(i * cluster + k) * BLOCK :][:BLOCK]
                self.content[self.block_of(number) + k] = part.ljust(BLOCK, b"\0")
        self.content[self.file] = self.head()

    def boot(self) -> bytes:
        boot = bytearray(BLOCK)
        boot[11:13] = BLOCK.to_bytes(2, "little")
        boot[13] = self.cluster
        boot[14:16] = self.reserved.to_bytes(2, "little")
        boot[16] = 2
        boot[32:40] = words(self.size, self.fat_blocks)
        boot[44:48] = words(2)
        boot[510:] = b"\x55\xaa"
        return bytes(boot)

    def entry(self) -> bytes:
        entry = bytearray(b"PROBE   LOG\x20".ljust(32, b"\0"))
        entry[20:22] = (self.first >> 16).to_bytes(2, "little")
        entry[26:28] = (self.first & 0xFFFF).to_bytes(2, "little")
        entry[28:32] = words(self.blocks * BLOCK)
        return bytes(entry)

    def head(self, **changed: int) -> bytes:
        part = {
            "version": 1,
            "size": BLOCK,
            "card_id": self.card_id,
            "lba": self.file,
            "blocks": self.blocks,
            "rest": 0,
        } | changed
        head = b"IMUPROBE" + words(part["version"] | part["size"] << 16)
        head += words(part["card_id"], part["lba"], part["blocks"], part["rest"])
        return sealed(head)

    def write_links(self) -> None:
        raw = words(*self.links)
        for i in range(self.fat_blocks):
            block = raw[i * BLOCK :][:BLOCK].ljust(BLOCK, b"\0")
            self.content[self.start + self.reserved + i] = block

    def block_of(self, cluster: int) -> int:
        return self.data + (cluster - 2) * self.cluster

    def good(self, number: int, recording: int = 1, content: bytes = b"") -> bytes:
        head = words(self.card_id, number, recording)
        return sealed(head + content)

    def card(self, **more: Any) -> FakeCard:
        # Whole megabytes, as a CSD counts.
        blocks = -(-(self.start + self.size) // 1024) * 1024
        card = FakeCard(blocks, **more)
        card.content = self.content
        return card


def words(*values: int) -> bytes:
    return b"".join(value.to_bytes(4, "little") for value in values)


def sealed(block: bytes) -> bytes:
    block = block.ljust(508, b"\0")
    return block + words(zlib.crc32(block))


def read(volume: Volume) -> dict[int, list[tuple[int, int, bytes]]]:
    """Return number, flags and content of each recording's blocks, as a host does."""
    found: dict[int, list[tuple[int, int, bytes]]] = {}
    bad = 0
    for number in range(1, volume.blocks):
        block = volume.content.get(volume.file + number, bytes(BLOCK))
        is_good = words(zlib.crc32(block[:508])) == block[508:] and block[:8] == words(
            volume.card_id, number
        )
        bad = 0 if is_good else bad + 1
        if bad > 8:
            break
        if is_good:
            assert block[11] == 0
            recording = int.from_bytes(block[8:10], "little")
            found.setdefault(recording, []).append((number, block[10], block[12:508]))
    return found


def frames_of(blocks: list[tuple[int, int, bytes]]) -> list[bytes]:
    """All that ends with a zero."""
    joined = b"".join(content for _, _, content in blocks)
    return [part for part in joined.split(b"\0")[:-1] if part]


def made_frame(number: int, length: int = FRAME) -> bytes:
    return f"{number:08}".encode().ljust(length - 1, b".") + b"\0"


class Log:
    """A probe that logs: the log, its ring, its wire, the time."""

    def __init__(
        self, card: FakeCard, *, ring: int = RING, wire: Wire | None = None
    ) -> None:
        self.card = card
        self.wire = wire or Wire(ffi, card)
        self.wire.card = card
        self.ring = ffi.new("uint8_t[]", ring)
        self.book = ffi.new("struct logbook *")
        lib.logbook_init(self.book, self.wire.device, self.ring, ring)
        self.changes: list[tuple[str, str, int]] = []
        self.put: list[tuple[float, bytes]] = []  # frames taken, with their times
        self.dropped = 0
        self.number = 0

    def step(self, tick_us: float = 1000.0) -> None:
        in_a_row = 0
        while lib.logbook_step(self.book, self.wire.time):
            in_a_row += 1
            assert in_a_row < 20, "it never lets go"
        change = ffi.new("struct logbook_change *")
        while lib.logbook_take_change(self.book, change):
            event, cause = EVENTS[change.event], CAUSES[change.cause]
            self.changes.append((event, cause, change.detail))
        self.wire.sleep(tick_us)

    @property
    def now_us(self) -> float:
        return self.wire.now_us

    @property
    def state(self) -> str:
        return STATES[self.status.card]

    @property
    def status(self) -> Any:
        out = ffi.new("struct message_equipment *")
        lib.logbook_describe(self.book, out)
        return out

    def run(self, us: float) -> Log:
        until = self.now_us + us
        while self.now_us < until:
            self.step(min(1000.0, until - self.now_us))
        return self

    def until(self, state: str, us: float = 5 * SECOND) -> Log:
        end = self.now_us + us
        while self.state != state:
            assert self.now_us < end, f"{self.state} for too long"
            self.step()
        return self

    def open(self) -> Log:
        assert lib.logbook_open(self.book)
        return self

    def keep(self, frame: bytes) -> bool:
        taken = lib.logbook_put(self.book, frame, len(frame))
        if taken:
            self.put.append((self.now_us, frame))
        else:
            self.dropped += 1
        return bool(taken)

    def log(self, us: float, rate_hz: float = RATE_HZ) -> Log:
        until = self.now_us + us
        at = self.now_us
        while self.now_us < until:
            while at <= self.now_us:
                self.number += 1
                self.keep(made_frame(self.number))
                at += SECOND / rate_hz
            self.step(max(at - self.now_us, 1))
        return self

    def close(self, cause: str = "command") -> Log:
        causes = {name: number for number, name in CAUSES.items()}
        lib.logbook_close(self.book, causes[cause])
        end = self.now_us + 3 * SECOND
        while not lib.logbook_is_idle(self.book):
            assert self.now_us < end, "it does not close"
            self.step()
        return self

    @property
    def kept(self) -> list[bytes]:
        return [frame[:-1] for _, frame in self.put]


def opened(volume: Volume, **more: Any) -> Log:
    return Log(volume.card(**more)).until("ready").open()


def loss(
    volume: Volume, put: list[tuple[float, bytes]], recording: int, cut_us: float
) -> float:
    """How far before the cut the first frame was put in that is not on the card."""
    on_card = {*frames_of(read(volume).get(recording, []))}
    lost = [at for at, frame in put if frame[:-1] not in on_card]
    return cut_us - min(lost, default=cut_us)
