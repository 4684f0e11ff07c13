# SPDX-License-Identifier: MIT
"""The model of an SD card with an SPI master and the time, for its tests."""

from __future__ import annotations

import binascii
import hashlib
from pathlib import Path
from typing import Any, ClassVar

import native

BLOCK = 512
MS = 1_000_000
SLOW, FAST = 400_000, 25_000_000  # Hz
IDLE, ILLEGAL, BAD_CRC, ADDRESS, PARAMETER = 0x01, 0x04, 0x08, 0x20, 0x40  # R1
ERASE_RESET, ERASE_SEQUENCE = 0x02, 0x10
ACCEPTED, CRC_ERROR, WRITE_ERROR = 0x05, 0x0B, 0x0D  # data responses, low 5 bits
HCS = 1 << 30

ffi, lib = native.load()


def crc7(data: bytes) -> int:
    """Divide by x^7 + x^3 + 1 (SD 4.5), bit by bit."""
    value = int.from_bytes(data, "big") << 7
    for shift in range(value.bit_length() - 8, -1, -1):
        if value >> (shift + 7) & 1:
            value ^= 0b10001001 << shift
    return value


def crc16(data: bytes) -> bytes:
    return binascii.crc_hqx(data, 0).to_bytes(2, "big")


def pattern(number: int) -> bytes:
    return hashlib.shake_128(number.to_bytes(4)).digest(BLOCK)


class Card:
    """A card in its socket, with an SPI master and the time."""

    KINDS: ClassVar = {"SDSC": lib.SDCARD_CHIP_SDSC, "SDHC": lib.SDCARD_CHIP_SDHC}

    def __init__(self, folder: Path, blocks: int = 256, **config: Any) -> None:
        self.path = folder / "card.img"
        if not self.path.exists():
            with self.path.open("wb") as file:
                file.truncate(blocks * BLOCK)
        self.config = ffi.new("struct sdcard_chip_config *")
        self.image = ffi.new("char[]", str(self.path).encode())
        self.config.image = self.image
        self.numbers: list[int] = []
        self.on_block = ffi.callback(
            "void(void *, uint64_t)", lambda _, number: self.numbers.append(number)
        )
        self.config.on_block = self.on_block
        for name, value in config.items():
            setattr(self.config, name, value)
        problem = ffi.new("char const **")
        made = lib.sdcard_chip_new(self.config, problem)
        if made == ffi.NULL:
            raise ValueError(ffi.string(problem[0]).decode())
        self.chip = ffi.gc(made, lib.sdcard_chip_free)
        self.now = 2 * MS
        self.hz = SLOW
        self.gaps: list[int] = []  # bytes before each answer

    # The wire

    def send(self, data: bytes | int) -> bytes:
        """Exchange bytes; an int is the number of bytes of 0xFF."""
        data = b"\xff" * data if isinstance(data, int) else data
        back = bytearray()
        for byte in data:
            self.now += 8 * 1_000_000_000 // self.hz
            back.append(lib.sdcard_chip_exchange(self.chip, self.now, self.hz, byte))
        return bytes(back)

    def select(self, *, on: bool = True) -> None:
        lib.sdcard_chip_select(self.chip, self.now, on)

    def deselect(self) -> None:
        """Raise CS, then give the 8 clocks that the card needs to finish (SD 4.4)."""
        self.select(on=False)
        self.send(1)

    def wait(self, ms: float) -> None:
        self.now += round(ms * MS)
        lib.sdcard_chip_advance(self.chip, self.now)

    def until(self, wanted: Any, limit: int = 200_000) -> int:
        """Return the first byte that `wanted` accepts; note how many came before it."""
        for count in range(limit):
            byte = self.send(1)[0]
            if wanted(byte):
                self.gaps.append(count)
                return byte
        raise TimeoutError

    @staticmethod
    def frame(index: int, argument: int = 0, crc: int | None = None) -> bytes:
        head = bytes([0x40 | index]) + argument.to_bytes(4, "big")
        return head + bytes([crc7(head) << 1 | 1 if crc is None else crc])

    def command(
        self, index: int, argument: int = 0, more: int = 0, crc: int | None = None
    ) -> bytes:
        """Send a command after a byte's pause; return R1 and `more` bytes."""
        self.send(1)
        self.send(self.frame(index, argument, crc))
        if index == 12:
            self.send(1)
        first = self.until(lambda byte: byte < 0x80, limit=10)
        return bytes([first]) + self.send(more)

    def r1(self, index: int, argument: int = 0, **options: Any) -> int:
        return self.command(index, argument, **options)[0]

    def app(self, index: int, argument: int = 0, more: int = 0) -> bytes:
        self.command(55)
        return self.command(index, argument, more)

    def ready(self) -> None:
        """Wait until the card is no longer busy (SD 7.3.2.2)."""
        self.until(lambda byte: byte == 0xFF)

    def token(self) -> int:
        return self.until(lambda byte: byte != 0xFF)

    def data(self, length: int = BLOCK) -> bytes:
        assert self.token() == 0xFE
        content, crc = self.send(length), self.send(2)
        assert crc == crc16(content)
        return content

    def put(self, content: bytes, token: int = 0xFE, crc: bytes | None = None) -> int:
        """Send a block; return the low five bits of its data response."""
        self.send(1)
        self.send(bytes([token]) + content)
        self.send(crc16(content) if crc is None else crc)
        return self.send(1)[0] & 0x1F

    # What hosts do

    def power_up(self) -> None:
        self.send(10)
        self.select()
        assert self.r1(0) == IDLE

    def identify(self) -> Card:
        self.power_up()
        assert self.command(8, 0x1AA, 4) == b"\x01\x00\x00\x01\xaa"
        while self.app(41, HCS)[0] & IDLE:
            self.wait(1)
        self.hz = FAST
        return self

    def address(self, block: int) -> int:
        ocr = int.from_bytes(self.command(58, more=4)[1:], "big")
        return block if ocr & HCS else block * BLOCK

    def write(self, block: int, content: bytes) -> int:
        assert self.r1(24, self.address(block)) == 0
        return self.put(content)

    def write_run(self, block: int, *contents: bytes) -> None:
        assert self.r1(25, self.address(block)) == 0
        for content in contents:
            assert self.put(content, 0xFC) == ACCEPTED
            self.ready()
        self.stop()

    def stop(self) -> None:
        self.send(b"\xff\xfd\xff")
        self.ready()

    def read(self, block: int) -> bytes:
        assert self.r1(17, self.address(block)) == 0
        return self.data()

    def stored(self, block: int, count: int = 1) -> bytes:
        with self.path.open("rb") as file:
            file.seek(block * BLOCK)
            return file.read(count * BLOCK)

    def fault(self, kind: str, **fields: int) -> None:
        fault = ffi.new("struct sdcard_chip_fault *")
        fault.kind = getattr(lib, f"SDCARD_CHIP_{kind}")
        for name, value in fields.items():
            setattr(fault, name, value)
        assert lib.sdcard_chip_add_fault(self.chip, fault)

    def cut(self) -> None:
        lib.sdcard_chip_cut(self.chip, self.now)

    def is_busy(self) -> bool:
        return bool(lib.sdcard_chip_is_busy(self.chip))

    def complaint(self) -> str | None:
        text = lib.sdcard_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()

    def complains(self, of: str) -> bool:
        return of in (self.complaint() or "")


def kind_of(stands: bytes, old: bytes, new: bytes) -> str:
    """What a power cut has left of a block: old, new or torn.

    A torn block is new up to some byte; old data, 0xFF or noise follow.
    """
    if stands == old:
        return "old"
    if stands == new:
        return "new"
    kept = next(i for i in range(BLOCK) if stands[i] != new[i])
    if stands[kept:] in (old[kept:], b"\xff" * (BLOCK - kept)):
        return "torn"
    # Noise: hardly any byte has its old value.
    same = sum(a == b for a, b in zip(stands[kept:], old[kept:], strict=True))
    assert same <= 3 + (BLOCK - kept) // 64
    return "torn"
