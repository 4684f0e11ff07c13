# SPDX-License-Identifier: MIT
"""`imud card prepare`: writes a FAT32 with an empty PROBE.LOG to a card or an image."""

from __future__ import annotations

import secrets
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from imud.card import disk, fat
from imud.card.disk import Disk
from imud.card.fat import SECTOR
from imud.card.listing import plural
from imud.card.probe_log import LOOK, find_log, head_block
from imud.errors import ConfigError, FileError
from imud.progress import Progress

# Sectors at the end of a card that may hold the copy of a GPT, which a computer would
# prefer to our MBR.
_GPT_COPY = 33

# Cards state their size in units of this many bytes (CSD, C_SIZE).
_CARD_UNIT = 512 << 10


def prepare(
    path: Path, *, size: int | None, log_size: int | None, is_agreed: bool
) -> int:
    """Prepares a card, or makes an image of `size` bytes; returns 0.

    `log_size` in bytes, None: all that fits. Raises ConfigError or FileError where it
    can't be done, and FileError when the user does not agree.
    """
    if size is not None:
        if size % _CARD_UNIT:
            raise ConfigError(f"--size {size} is not a multiple of 512K, as cards are")
        if path.exists():
            raise FileError(f"{path} already exists; --size is for a new image")
        layout = _lay_out(path, size // SECTOR, log_size)
        with disk.created(path, size) as card:
            _write(card, layout, is_fresh=True)
        return 0
    if not path.exists() and path.parent.is_dir() and path.parent != Path("/dev"):
        raise FileError(f"{path} does not exist; --size BYTES creates an image")
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
            "overwritten; pass --yes"
        )
    sys.stderr.write(
        f"{card.path} has {_size(card.bytes)} and holds {_what_is_on(card)}.\nAll of "
        "it will be lost. Type yes to continue: "
    )
    sys.stderr.flush()
    if sys.stdin.readline().strip() != "yes":
        raise FileError(f"{card.path} was not changed")


def _what_is_on(card: Disk) -> str:
    try:
        log = find_log(card)
    except FileError:
        return _what_else_is_on(card.read_at(0, LOOK * SECTOR))
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
        return f"{plural(len(types), 'partition')} (type {names})"
    return "something else" if any(begin) else "no file system"


def _write(card: Disk, layout: fat.Layout, *, is_fresh: bool) -> None:
    card_id = secrets.randbelow(2**32 - 1) + 1
    identity = secrets.randbits(32)
    now = time.localtime()
    table = fat.partition_table(layout, identity)
    head = head_block(card_id, layout.log, layout.log_sectors)

    def pieces() -> Iterator[tuple[int, bytes]]:
        yield 0, bytes(SECTOR)  # it is no probe's card until all is written
        yield from fat.sectors_before_log(layout, identity, now)
        yield layout.log, head
        yield card.sectors - _GPT_COPY, bytes(_GPT_COPY * SECTOR)

    bar = Progress("preparing", 2 * layout.log)
    try:
        for sector, data in pieces():
            # A fresh image is zeros already, which take no room on the disk.
            if not is_fresh or any(data):
                card.write(sector, data)
            bar.update(min(sector, layout.log))
        card.settle()
        card.write(0, table)
        card.settle()
        for sector, data in pieces():
            if card.read(sector, len(data) // SECTOR) != (data if sector else table):
                raise FileError(
                    f"{card.path} does not store what is written (sector {sector}); "
                    "use another card"
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


def _size(count: int) -> str:
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= unit:
            return f"{count / unit:.1f} {name}"
    return f"{count} bytes"
