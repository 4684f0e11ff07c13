# SPDX-License-Identifier: MIT
"""The model of the SD card against the SD Association's document.

Numbers are typed from SD Specifications, Part 1, Physical Layer Simplified
Specification, version 4.10 (SD; sections by their numbers), not taken from the model.
"""

from __future__ import annotations

import binascii
import hashlib
import itertools
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import bare
import chips

BLOCK = 512
MS = 1_000_000
SLOW, FAST = 400_000, 25_000_000  # Hz
IDLE, ILLEGAL, BAD_CRC, ADDRESS, PARAMETER = 0x01, 0x04, 0x08, 0x20, 0x40  # R1
ERASE_RESET, ERASE_SEQUENCE = 0x02, 0x10
ACCEPTED, CRC_ERROR, WRITE_ERROR = 0x05, 0x0B, 0x0D  # data responses, their low 5 bits
HCS = 1 << 30

ffi, lib = chips.load("sdcard", core=False)
NOWHERE = ffi.new("char[]", b"/no/such/image")


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
    """A card in its socket, the time, and an SPI master."""

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
        self.gaps: list[int] = []  # before each answer, in bytes

    # The wire

    def send(self, data: bytes | int) -> bytes:
        """Exchange bytes; an int is so many of 0xFF."""
        data = b"\xff" * data if isinstance(data, int) else data
        back = bytearray()
        for byte in data:
            self.now += 8 * 1_000_000_000 // self.hz
            back.append(lib.sdcard_chip_exchange(self.chip, self.now, self.hz, byte))
        return bytes(back)

    def select(self, *, on: bool = True) -> None:
        lib.sdcard_chip_select(self.chip, self.now, on)

    def deselect(self) -> None:
        """Raise CS, with the 8 clocks that let the card finish (SD 4.4)."""
        self.select(on=False)
        self.send(1)

    def wait(self, ms: float) -> None:
        self.now += round(ms * MS)
        lib.sdcard_chip_advance(self.chip, self.now)

    def until(self, wanted: Any, limit: int = 200_000) -> int:
        """The first byte of which `wanted` is true, and how many came before it."""
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
        """A byte's pause, a command, its answer: R1 and `more` bytes."""
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
        """Wait while it is busy: a byte that is not zero ends it (SD 7.3.2.2)."""
        self.until(lambda byte: byte == 0xFF)

    def token(self) -> int:
        return self.until(lambda byte: byte != 0xFF)

    def data(self, length: int = BLOCK) -> bytes:
        assert self.token() == 0xFE
        content, crc = self.send(length), self.send(2)
        assert crc == crc16(content)
        return content

    def put(self, content: bytes, token: int = 0xFE, crc: bytes | None = None) -> int:
        """A block; the low five bits of its data response."""
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


@pytest.fixture
def fresh(tmp_path: Path) -> Iterator[Card]:
    """Just powered; a host that keeps to the document."""
    card = Card(tmp_path)
    yield card
    assert card.complaint() is None


@pytest.fixture(params=["SDSC", "SDHC"])
def card(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Card]:
    """Identified, of either kind, by a host that keeps to the document."""
    kind = getattr(lib, f"SDCARD_CHIP_{request.param}")
    card = Card(tmp_path, blocks=2048, kind=kind).identify()
    yield card
    assert card.complaint() is None


@pytest.fixture
def rude(tmp_path: Path) -> Card:
    """Identified; the host does something against the document."""
    return Card(tmp_path, blocks=2048).identify()


# Power-up and identification (SD 6.4.1, 7.2.1)


def test_a_reset_is_answered_after_74_clocks(fresh: Card) -> None:
    fresh.power_up()


@pytest.mark.parametrize(
    ("wait_ns", "with_cs_high", "with_cs_low"),
    [(2 * MS, 9, 0), (2 * MS, 0, 20), (500_000, 10, 0)],
)
def test_fewer_clocks_or_less_than_a_millisecond_are_not_enough(
    tmp_path: Path, wait_ns: int, with_cs_high: int, with_cs_low: int
) -> None:
    card = Card(tmp_path)
    card.now = wait_ns
    card.send(with_cs_high)
    card.select()
    card.send(with_cs_low)
    with pytest.raises(TimeoutError):
        card.r1(0)
    assert card.complains("1 ms and 74 clocks")


@pytest.mark.parametrize(("index", "crc"), [(0, 0x97), (8, None), (17, None)])
def test_nothing_but_a_good_cmd0_is_heard_first(
    tmp_path: Path, index: int, crc: int | None
) -> None:
    card = Card(tmp_path)
    card.send(10)
    card.select()
    with pytest.raises(TimeoutError):
        card.r1(index, crc=crc)
    assert card.complains("no valid CMD0 first")
    assert card.r1(0) == IDLE


def test_the_document_s_own_commands_have_the_crcs_that_it_prints() -> None:
    # SD 4.5 and 7.2.2: CMD0, CMD17 with argument 0, 512 bytes of 0xFF.
    assert Card.frame(0) == bytes.fromhex("400000000095")
    assert Card.frame(17) == bytes.fromhex("510000000055")
    assert crc16(b"\xff" * 512) == b"\x7f\xa1"


@pytest.mark.parametrize("check", [0xAA, 0x00, 0x5B])
def test_cmd8_echoes_voltage_and_pattern(fresh: Card, check: int) -> None:
    fresh.power_up()
    assert fresh.command(8, 0x100 | check, 4) == bytes([1, 0, 0, 1, check])


@pytest.mark.parametrize("voltage", [0, 2, 3])
def test_cmd8_with_another_voltage_gets_none_back(fresh: Card, voltage: int) -> None:
    fresh.power_up()
    assert fresh.command(8, voltage << 8 | 0xAA, 4) == b"\x01\x00\x00\x00\xaa"


def test_cmd8_is_checked_even_where_crc_is_off(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    assert card.r1(8, 0x1AA, crc=0x85) == BAD_CRC | IDLE
    assert card.complains("wrong CRC")


def test_initialisation_takes_its_time(tmp_path: Path) -> None:
    times = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed)
        card.power_up()
        card.command(8, 0x1AA, 4)
        start = card.now
        while card.app(41, HCS)[0] == IDLE:
            card.wait(1)
        times.add((card.now - start) // MS)
        assert card.complaint() is None
    assert min(times) >= 20
    assert max(times) <= 302  # and a round of the host's; SD 4.2.3: within 1 s
    assert len(times) > 6


@pytest.mark.parametrize(("sees_cmd8", "argument"), [(True, 0), (False, HCS)])
def test_high_capacity_waits_for_a_host_that_knows_it(
    tmp_path: Path, sees_cmd8: bool, argument: int
) -> None:
    card = Card(tmp_path, blocks=2048, kind=lib.SDCARD_CHIP_SDHC)
    card.power_up()
    if sees_cmd8:
        card.command(8, 0x1AA, 4)
    for _ in range(1200):
        assert card.app(41, argument)[0] == IDLE
        card.wait(1)
    assert (card.complaint() is None) is sees_cmd8


def test_standard_capacity_ignores_hcs(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    card.command(8, 0x1AA, 4)
    card.app(41, 0)
    card.wait(301)
    assert card.app(41, 0)[0] == 0
    assert card.complaint() is None


def test_a_card_of_version_1_knows_no_cmd8(tmp_path: Path) -> None:
    card = Card(tmp_path, is_version_1=True)
    card.power_up()
    assert card.r1(8, 0x1AA) == ILLEGAL | IDLE
    card.app(41)
    card.wait(301)
    assert card.app(41)[0] == 0
    assert card.complaint() is None


def test_the_ocr_tells_ready_and_capacity(card: Card) -> None:
    is_high = card.config.kind == lib.SDCARD_CHIP_SDHC
    ocr = int.from_bytes(card.command(58, more=4)[1:], "big")
    assert ocr == 0x80FF8000 | (HCS if is_high else 0)
    assert card.r1(0) == IDLE
    card.hz = SLOW
    assert card.command(58, more=4) == b"\x01\x00\xff\x80\x00"


def test_what_must_wait_for_ready_is_refused(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    for index in (9, 10, 13, 16, 17, 18, 24, 25, 32):
        assert card.r1(index, 512) == ILLEGAL | IDLE
    assert card.complains("must wait")


def test_only_acmd41_is_repeated_while_it_initialises(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.power_up()
    card.command(8, 0x1AA, 4)
    card.app(41, HCS)
    assert card.complaint() is None
    card.command(58, more=4)
    assert card.complains("while ACMD41 is repeated")


def test_the_clock_has_its_limits(tmp_path: Path) -> None:
    early, late = Card(tmp_path), Card(tmp_path)
    for card in (early, late):
        card.hz = 400_000
        card.power_up()
        assert card.complaint() is None
    early.hz = 400_001
    early.send(1)
    assert early.complains("above 400 kHz")
    late.command(8, 0x1AA, 4)
    late.app(41, HCS)
    late.wait(301)
    late.app(41, HCS)
    late.hz = 25_000_000
    late.send(1)
    assert late.complaint() is None
    late.hz = 25_000_001
    late.send(1)
    assert late.complains("above 25 MHz")


@pytest.mark.parametrize("index", [1, 2, 3, 5, 7, 11, 12, 15, 20, 23, 28, 52, 63])
def test_what_is_no_command_here_is_illegal(card: Card, index: int) -> None:
    assert card.r1(index) == ILLEGAL
    assert card.r1(13) == 0  # told once


@pytest.mark.parametrize("index", [6, 27, 42, 56])
def test_what_is_not_modelled_says_so(rude: Card, index: int) -> None:
    assert rude.r1(index) == ILLEGAL
    assert rude.complains("not modelled")


def test_an_application_s_command_that_is_none_is_the_plain_one(card: Card) -> None:
    assert card.app(17, 0)[0] == 0
    assert card.data() == bytes(BLOCK)


# Registers (SD chapter 5)


def csd_of(card: Card) -> int:
    assert card.r1(9) == 0
    content = card.data(16)
    assert content[15] == crc7(content[:15]) << 1 | 1
    return int.from_bytes(content, "big")


def bits(register: int, high: int, low: int) -> int:
    return register >> low & (1 << high - low + 1) - 1


@pytest.mark.parametrize(
    "size",
    [
        1 << 20,
        8 << 20,
        100_000 * 512,
        5000 * 2048,  # beyond 4096 of the least unit
        1 << 30,
        2 << 30,
    ],
)
def test_the_csd_of_an_sdsc_card_gives_its_size(tmp_path: Path, size: int) -> None:
    card = Card(tmp_path, blocks=size // BLOCK).identify()
    csd = csd_of(card)
    assert bits(csd, 127, 126) == 0
    assert bits(csd, 103, 96) == 0x32
    block = 1 << bits(csd, 83, 80)
    size_told = (bits(csd, 73, 62) + 1) * (1 << bits(csd, 49, 47) + 2) * block
    assert size_told == size == lib.sdcard_chip_blocks(card.chip) * BLOCK
    assert bits(csd, 79, 79) == 1  # READ_BL_PARTIAL
    assert bits(csd, 25, 22) == bits(csd, 83, 80)
    assert card.complaint() is None


@pytest.mark.parametrize("size", [(2 << 30) + (1 << 19), 4 << 30, 32 << 30])
def test_the_csd_of_an_sdhc_card_gives_its_size(tmp_path: Path, size: int) -> None:
    card = Card(tmp_path, blocks=size // BLOCK).identify()
    csd = csd_of(card)
    assert bits(csd, 127, 126) == 1
    assert (bits(csd, 69, 48) + 1) * 512 * 1024 == size
    # SD 5.3.3: fixed to these.
    assert [bits(csd, 119, 112), bits(csd, 111, 104)] == [0x0E, 0x00]
    assert [bits(csd, 83, 80), bits(csd, 79, 79), bits(csd, 46, 46)] == [9, 0, 1]
    assert [bits(csd, 45, 39), bits(csd, 28, 26), bits(csd, 25, 22)] == [0x7F, 2, 9]


def test_the_last_block_of_32_gb_is_written_and_little_of_the_disk(
    tmp_path: Path,
) -> None:
    card = Card(tmp_path, blocks=64 << 20).identify()
    last = (64 << 20) - 1
    assert card.write(last, pattern(1)) == ACCEPTED
    card.ready()
    assert card.read(last) == pattern(1)
    assert card.r1(17, last + 1) == PARAMETER
    assert card.path.stat().st_blocks * 512 < 1 << 20


@pytest.mark.parametrize(
    ("size", "kind", "problem"),
    [
        (0, "BY_SIZE", "multiple of 512"),
        (513, "BY_SIZE", "multiple of 512"),
        (512, "BY_SIZE", "no SDSC card"),
        ((64 << 20) + 512, "BY_SIZE", "a multiple of 512 KB"),
        ((4 << 30) + 512, "BY_SIZE", "no SDHC card"),
        ((2 << 30) + 512, "SDSC", "no SDSC card"),
        (511 * 1024, "SDHC", "no SDHC card"),
    ],
)
def test_what_is_no_card_is_told(
    tmp_path: Path, size: int, kind: str, problem: str
) -> None:
    with (tmp_path / "card.img").open("wb") as file:
        file.truncate(size)
    with pytest.raises(ValueError, match=problem):
        Card(tmp_path, kind=getattr(lib, f"SDCARD_CHIP_{kind}"))


def test_an_image_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no file"):
        Card(tmp_path, image=NOWHERE)


def test_the_cid_is_one_card_s_own(tmp_path: Path) -> None:
    serials = set()
    for seed in range(8):
        card = Card(tmp_path, seed=seed).identify()
        assert card.r1(10) == 0
        cid = card.data(16)
        assert cid[15] == crc7(cid[:15]) << 1 | 1
        assert cid[3:8] == b"CARD1"
        serials.add(cid[9:13])
    assert len(serials) == 8


def test_status_and_configuration_come_as_data(card: Card) -> None:
    is_high = card.config.kind == lib.SDCARD_CHIP_SDHC
    assert card.app(13, more=1) == b"\x00\x00"
    status = card.data(64)
    assert status[:8] == bytes(8)
    assert status[10] >> 4 == (9 if is_high else 6)  # AU_SIZE
    assert card.app(51)[0] == 0
    # SD 5.6: version 2.00; both bus widths.
    scr = card.data(8)
    assert scr[:2] == (b"\x02\x35" if is_high else b"\x02\x25")
    assert card.app(42)[0] == 0


# Reading


def test_a_block_is_read_as_it_stands(card: Card) -> None:
    with card.path.open("r+b") as file:
        file.seek(7 * BLOCK)
        file.write(pattern(7) + pattern(8))
    assert card.read(7) == pattern(7)
    assert card.read(8) == pattern(8)
    assert card.read(9) == bytes(BLOCK)


def test_a_run_is_read_until_it_is_stopped(card: Card) -> None:
    with card.path.open("r+b") as file:
        for number in range(5):
            file.write(pattern(number))
    assert card.r1(18, card.address(0)) == 0
    for number in range(5):
        assert card.data() == pattern(number)
    assert card.r1(12) == 0
    card.ready()
    assert card.r1(13) == 0


def test_a_run_is_stopped_amid_a_block(card: Card) -> None:
    assert card.r1(18, 0) == 0
    assert card.token() == 0xFE
    card.send(100)
    assert card.r1(12) == 0
    card.ready()
    assert card.read(1) == bytes(BLOCK)


def test_the_byte_behind_cmd12_is_no_answer(tmp_path: Path) -> None:
    seen = set()
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(bytes(BLOCK))
        card.r1(18, 0)
        card.token()
        card.send(10)
        seen.add(card.send(card.frame(12) + b"\xff")[-1])
    assert seen == {0x3F}  # two bits of the data, then the line's rest


def test_a_stopped_read_may_be_busy_or_not(tmp_path: Path) -> None:
    seen = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        card.r1(18, 0)
        card.data()
        assert card.r1(12) == 0
        seen.add(card.send(1)[0])
        card.ready()
        assert card.complaint() is None
    assert seen == {0x00, 0xFF}


def test_a_run_that_leaves_the_card_ends_in_an_error_token(card: Card) -> None:
    assert card.r1(18, card.address(2047)) == 0
    card.data()
    assert card.token() == 0x08  # SD 7.3.3.3: out of range
    assert card.send(600) == b"\xff" * 600
    assert card.r1(12) == 0
    card.ready()
    assert card.command(13, more=1) == b"\x00\x80"
    assert card.command(13, more=1) == b"\x00\x00"


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_an_address_beyond_the_card_is_a_parameter_error(
    card: Card, index: int
) -> None:
    assert card.r1(index, card.address(2048)) == PARAMETER
    assert card.r1(13) == 0


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_bytes_that_cross_a_block_are_an_address_error(
    tmp_path: Path, index: int
) -> None:
    card = Card(tmp_path).identify()
    assert card.r1(index, 513) == ADDRESS
    assert card.complaint() is None


def test_a_part_of_a_block_is_read_from_standard_capacity(tmp_path: Path) -> None:
    card = Card(tmp_path).identify()
    with card.path.open("r+b") as file:
        file.write(pattern(0))
    assert card.r1(16, 16) == 0
    assert card.r1(17, 100) == 0
    assert card.data(16) == pattern(0)[100:116]
    assert card.r1(17, 500) == ADDRESS
    assert card.r1(24, 0) == PARAMETER  # WRITE_BL_PARTIAL is 0
    assert card.complaint() is None


def test_the_block_length_of_high_capacity_stays(tmp_path: Path) -> None:
    card = Card(tmp_path, 2048, kind=lib.SDCARD_CHIP_SDHC).identify()
    assert card.r1(16, 16) == 0
    assert len(card.read(1)) == BLOCK


@pytest.mark.parametrize("length", [0, 513, 0xFFFFFFFF])
def test_a_block_length_that_can_not_be_is_refused(card: Card, length: int) -> None:
    assert card.r1(16, length) == PARAMETER


# Writing


def test_a_block_is_there_once_busy_is_over(card: Card) -> None:
    assert card.write(5, pattern(5)) == ACCEPTED
    assert card.send(1) == b"\x00"
    assert card.stored(5) == bytes(BLOCK)
    card.ready()
    assert card.stored(5) == pattern(5)
    assert card.read(5) == pattern(5)
    assert card.read(4) == card.read(6) == bytes(BLOCK)


def test_a_run_is_there_once_it_is_stopped(card: Card) -> None:
    contents = [pattern(i) for i in range(40)]
    card.write_run(10, *contents)
    assert card.stored(10, 40) == b"".join(contents)
    assert card.numbers == list(range(1, 41))
    assert lib.sdcard_chip_written(card.chip) == 40
    assert card.app(22)[0] == 0
    assert card.data(4) == bytes([0, 0, 0, 40])


def test_a_run_s_last_blocks_are_not_there_before(card: Card) -> None:
    card.r1(25, card.address(0))
    for number in range(20):
        card.put(pattern(number), 0xFC)
        card.ready()
    assert card.stored(0, 4) == b"".join(pattern(i) for i in range(4))
    assert card.stored(4, 16) == bytes(16 * BLOCK)
    card.stop()


def test_a_run_that_leaves_the_card_is_rejected(card: Card) -> None:
    card.r1(25, card.address(2047))
    assert card.put(pattern(1), 0xFC) == ACCEPTED
    card.ready()
    assert card.put(pattern(2), 0xFC) == WRITE_ERROR
    assert card.r1(12) == 0
    card.ready()
    assert card.command(13, more=1) == b"\x00\x80"
    card.app(22)
    assert card.data(4) == bytes([0, 0, 0, 1])
    assert card.stored(2047) == pattern(1)


def test_blocks_announced_and_not_sent_are_anything(tmp_path: Path) -> None:
    kept = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 64 * BLOCK)
        card.app(23, 8)
        card.write_run(10, pattern(0), pattern(1))
        assert card.stored(10, 2) == pattern(0) + pattern(1)
        rest = card.stored(12, 6)
        gone = rest.count(bytes(BLOCK)[:1]) // BLOCK
        assert rest == bytes(gone * BLOCK) + b"\x55" * (6 - gone) * BLOCK
        assert card.stored(18) == b"\x55" * BLOCK
        kept.add(gone)
        assert card.complaint() is None
    assert {0, 6} & kept
    assert len(kept) > 2


def test_erased_blocks_read_as_zeros(card: Card) -> None:
    card.write_run(0, *[b"\x77" * BLOCK] * 10)
    assert card.r1(32, card.address(3)) == 0
    assert card.command(58, more=4)[0] == ERASE_RESET
    assert card.r1(33, 0) == ERASE_SEQUENCE
    first, last = card.address(3), card.address(6)
    assert [card.r1(32, first), card.r1(33, last), card.r1(38)] == [0, 0, 0]
    card.ready()
    assert card.stored(0, 10).count(0) == 4 * BLOCK
    assert card.stored(3, 4) == bytes(4 * BLOCK)
    assert card.r1(38) == ERASE_SEQUENCE
    assert card.r1(33, last) == ERASE_SEQUENCE
    assert [card.r1(32, first), card.r1(33, last)] == [0, 0]
    assert card.r1(33, last) == ERASE_SEQUENCE
    assert [card.r1(32, last), card.r1(33, first), card.r1(38)] == [0, 0, 0]
    assert card.command(13, more=1) == b"\x00\x40"
    assert card.r1(32, card.address(2048)) == PARAMETER


def test_crcs_count_once_they_are_turned_on(tmp_path: Path) -> None:
    card = Card(tmp_path).identify()
    assert card.r1(24, 0, crc=0x01) == 0
    assert card.put(pattern(1), crc=b"\x00\x00") == ACCEPTED
    card.ready()
    assert card.r1(59, 1) == 0
    assert card.r1(24, 0) == 0
    assert card.put(pattern(2)) == ACCEPTED
    card.ready()
    assert card.complaint() is None
    assert card.r1(24, 0) == 0
    assert card.put(pattern(3), crc=b"\x00\x00") == CRC_ERROR
    assert card.send(1) == b"\xff"
    assert card.complains("block with a wrong CRC")
    assert card.r1(17, 0, crc=0x01) == BAD_CRC
    assert card.stored(0) == pattern(2)
    assert lib.sdcard_chip_bad_crc(card.chip) == 2
    assert card.r1(59, 0) == 0
    assert card.r1(13, crc=0x01) == 0


# Gaps and busy (SD 7.5)


def test_gaps_stay_within_their_limits_and_vary(card: Card) -> None:
    card.gaps.clear()
    for _ in range(100):
        card.r1(13)
        card.send(1)
    assert set(card.gaps) == set(range(1, 9))  # NCR: the first byte can't be it
    card.gaps.clear()
    for _ in range(60):
        card.r1(9)
        card.data(16)
    assert set(card.gaps[1::2]) == set(range(9))  # NCX
    us = []
    for _ in range(60):
        assert card.r1(17, 0) == 0
        start = card.now
        card.data()
        us.append((card.now - start) / 1000 - 515 * 0.32)
    assert min(us) > 30
    assert max(us) < 401
    assert len(set(us)) > 30


def test_busy_is_of_a_flash_s_length(card: Card) -> None:
    us = []
    for _ in range(120):
        card.write(1, pattern(1))
        start = card.now
        card.ready()
        us.append((card.now - start) / 1000)
    usual = [time for time in us if time < 2001]
    assert min(us) >= 300
    assert max(us) < 40_001
    assert len(usual) >= 110
    assert len(set(usual)) > 100


def test_now_and_then_busy_is_long(tmp_path: Path) -> None:
    card = Card(tmp_path, seed=3).identify()
    for _ in range(1000):
        card.write(1, pattern(1))
        card.send(1)
        card.wait(41)
        assert not card.is_busy()
        card.ready()
    worst = lib.sdcard_chip_busy_worst_ns(card.chip)
    assert 4 * MS < worst <= 40 * MS


def test_busy_is_seen_while_selected_and_goes_on_without(card: Card) -> None:
    card.write(1, pattern(1))
    assert card.send(3) == bytes(3)
    card.deselect()
    assert card.send(3) == b"\xff" * 3
    card.select()
    first, *rest = card.send(3)
    assert first in (0x00, 0x80)  # low from one clock after CS on
    assert rest == [0, 0]
    card.deselect()
    card.wait(41)
    assert card.stored(1) == pattern(1)
    card.select()
    assert card.send(2) == b"\xff\xff"


def test_busy_ends_amid_a_byte(card: Card) -> None:
    ends = set()
    for _ in range(60):
        card.write(1, pattern(1))
        ends.add(card.until(lambda byte: byte != 0))
        assert card.send(1) == b"\xff"
    assert ends == {0xFF >> bit for bit in range(8)}


def test_programming_waits_for_the_clocks_behind_the_response(card: Card) -> None:
    assert card.write(1, pattern(1)) == ACCEPTED
    card.select(on=False)
    card.wait(1000)
    assert card.stored(1) == bytes(BLOCK)
    card.send(1)  # CS is irrelevant (SD 4.4)
    card.wait(41)
    assert card.stored(1) == pattern(1)
    card.select()


def test_busy_after_a_stop_may_come_a_byte_late(tmp_path: Path) -> None:
    seen = set()
    for seed in range(12):
        card = Card(tmp_path, seed=seed).identify()
        card.r1(25, 0)
        card.put(pattern(0), 0xFC)
        card.ready()
        seen.add(card.send(b"\xff\xfd\xff\xff")[2:])
        card.ready()
        assert card.complaint() is None
    assert seen == {b"\x00\x00", b"\xff\x00"}  # NBR: 0 or 1


def test_the_free_bits_of_a_data_response_are_free(card: Card) -> None:
    seen = set()
    for _ in range(60):
        card.r1(24, 0)
        card.send(b"\xff\xfe" + pattern(0) + bytes(2))
        seen.add(card.send(1)[0])
        card.ready()
    assert seen == {high << 5 | ACCEPTED for high in range(8)}


def test_a_card_may_be_left_alone_between_blocks_while_it_is_busy(card: Card) -> None:
    card.fault("SLOW", from_ns=card.now, for_ns=50 * MS, ms=20)
    card.r1(25, card.address(0))
    for number in range(3):
        assert card.put(pattern(number), 0xFC) == ACCEPTED
        card.send(1)
        card.deselect()
        card.wait(30)
        card.select()
        card.ready()
    card.stop()
    assert card.stored(0, 3) == b"".join(pattern(i) for i in range(3))


# Against the document


def test_a_command_wants_a_byte_s_pause_behind_an_answer(rude: Card) -> None:
    rude.r1(16, 512)
    rude.send(rude.frame(13))
    assert rude.complains("NRC")


def test_a_command_wants_the_last_one_s_answer(rude: Card) -> None:
    rude.r1(13)  # the second byte of R2 is yet to come
    rude.send(rude.frame(13))
    assert rude.complains("before the answer")


def test_a_block_wants_a_byte_s_pause_behind_an_answer(rude: Card) -> None:
    rude.r1(24, 0)
    rude.send(b"\xfe")
    assert rude.complains("NWR")


def test_a_command_while_it_is_busy_is_not_heard(rude: Card) -> None:
    rude.write(1, pattern(1))
    assert rude.send(b"\xff" + rude.frame(13) + b"\xff" * 20) == bytes(27)
    assert rude.complains("while it is busy")
    rude.ready()
    assert rude.stored(1) == pattern(1)


def test_a_block_while_it_is_busy_is_not_taken(rude: Card) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.send(b"\xff\xfc")
    assert rude.complains("token before it is ready")


def test_a_reset_breaks_programming_off(tmp_path: Path) -> None:
    outcomes = set()
    for seed in range(30):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.truncate(0)
            file.truncate(256 * BLOCK)
        card.write(1, pattern(1))
        card.send(2)
        assert card.r1(0) == IDLE
        assert card.complains("while it is busy")
        assert not card.is_busy()
        outcomes.add(card.stored(1) == pattern(1))
    assert outcomes == {False, True}


@pytest.mark.parametrize("length", [1, 5, 6, 7])
def test_deselecting_amid_a_command_or_its_answer(rude: Card, length: int) -> None:
    rude.send(1)
    rude.send((rude.frame(13) + b"\xff")[:length])
    rude.select(on=False)
    assert rude.complains("deselected amid")
    rude.send(1)
    rude.select()
    assert rude.r1(13) == 0


@pytest.mark.parametrize("index", [17, 18, 24, 25])
def test_deselecting_amid_a_transfer_ends_it(rude: Card, index: int) -> None:
    rude.r1(index, 0)
    rude.send(1)
    rude.select(on=False)
    assert rude.complains("deselected amid")
    rude.send(1)
    rude.select()
    assert rude.r1(13) == 0


def test_a_run_that_is_left_is_programmed_but_for_the_block_under_way(
    rude: Card,
) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    rude.send(b"\xff\xfc" + pattern(1)[:100])
    rude.select(on=False)
    rude.wait(41)
    assert rude.stored(0, 2) == pattern(0) + bytes(BLOCK)


def test_another_command_amid_a_read_is_illegal(rude: Card) -> None:
    rude.r1(18, 0)
    assert rude.r1(13) == ILLEGAL
    assert rude.complains("amid a transfer")


@pytest.mark.parametrize(
    ("index", "token"), [(24, 0xFC), (25, 0xFE), (24, 0xFD), (24, 0x00)]
)
def test_another_write_s_token_is_none(rude: Card, index: int, token: int) -> None:
    rude.r1(index, 0)
    rude.send(bytes([0xFF, token]))
    assert rude.complains("no token of this write")


def test_a_rejected_run_wants_its_cmd12(rude: Card) -> None:
    rude.fault("ERROR", first=2, count=1)
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    assert rude.put(pattern(1), 0xFC) == WRITE_ERROR
    rude.send(b"\xff\xfc" + pattern(2) + bytes(2))
    assert rude.send(3) == b"\xff" * 3
    assert rude.complains("after one that was rejected")
    assert rude.r1(12) == 0
    rude.ready()
    assert rude.stored(0, 3) == pattern(0) + bytes(2 * BLOCK)


def test_a_rejected_run_is_no_token_s_to_end(rude: Card) -> None:
    rude.fault("ERROR", first=1, count=1)
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.stop()
    assert rude.complains("CMD12")


def test_a_good_run_is_no_cmd12_s_to_end(rude: Card) -> None:
    rude.r1(25, 0)
    rude.put(pattern(0), 0xFC)
    rude.ready()
    assert rude.r1(12) == ILLEGAL
    assert rude.complains("amid a transfer")


def test_reserved_bits_are_zero(tmp_path: Path) -> None:
    eight, other = Card(tmp_path), Card(tmp_path)
    eight.power_up()
    eight.command(8, 0x11AA, 4)
    assert eight.complains("CMD8")
    other.power_up()
    other.command(8, 0x1AA, 4)
    other.app(41, HCS | 0xFF8000)
    assert other.complains("ACMD41")


def test_the_first_complaint_stays(rude: Card) -> None:
    rude.send(b"\x00")
    first = rude.complaint()
    rude.r1(42)
    assert rude.complaint() == first


def test_a_host_that_is_reset_amid_a_run_is_no_complaint(card: Card) -> None:
    card.r1(25, card.address(0))
    card.put(pattern(0), 0xFC)
    card.ready()
    card.send(b"\xff\xfc" + pattern(1)[:100])
    lib.sdcard_chip_host_reset(card.chip, card.now)
    card.select(on=False)
    card.hz = SLOW
    card.wait(50)
    card.identify()
    assert card.read(0) == pattern(0)
    assert card.read(1) == bytes(BLOCK)


# Faults


def test_a_pulled_card_leaves_the_line_high_and_comes_back_fresh(card: Card) -> None:
    card.write(3, pattern(3))
    card.ready()
    out = card.now + 10 * MS
    card.fault("PULLED", from_ns=out, for_ns=100 * MS)
    assert card.read(3) == pattern(3)
    card.wait(10)
    assert card.send(card.frame(13) + b"\xff" * 20) == b"\xff" * 26
    card.wait(100)
    # Back in: the host that goes on as before is neither heard nor blamed.
    assert card.send(card.frame(13) + b"\xff" * 20) == b"\xff" * 26
    card.deselect()
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(3) == pattern(3)


def test_a_card_may_be_put_in_later(tmp_path: Path) -> None:
    card = Card(tmp_path)
    card.fault("PULLED", for_ns=500 * MS)
    card.send(10)
    card.select()
    with pytest.raises(TimeoutError):
        card.r1(0)
    card.deselect()
    card.now = 502 * MS
    card.identify()
    assert card.complaint() is None


def test_a_card_pulled_while_it_programs_is_torn_there_and_then(tmp_path: Path) -> None:
    seen = set()
    for seed in range(40):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 10 * BLOCK)
        card.fault("PULLED", from_ns=card.now + 600_000)
        card.write(1, pattern(1))
        card.send(1)
        card.wait(5)
        seen.add(kind_of(card.stored(1), b"\x55" * BLOCK, pattern(1)))
        assert card.stored(0) == card.stored(2) == b"\x55" * BLOCK
        card.wait(5)
        assert card.complaint() is None
    assert {"old", "new", "torn"} <= seen


@pytest.mark.parametrize("kind", ["PULLED", "DEAD"])
def test_a_card_can_go_within_a_block(card: Card, kind: str) -> None:
    card.fault(kind, first=2, count=1, after_ns=200_000, for_ns=100 * MS)
    card.write(1, pattern(1))
    card.ready()
    card.write(2, pattern(2))
    assert card.send(1) == b"\x00"
    card.wait(0.19)
    assert card.send(1) == b"\x00"
    card.wait(0.01)
    assert card.send(1) == b"\xff"
    card.wait(99)
    assert card.send(30) == b"\xff" * 30
    card.wait(2)
    card.deselect()
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(1) == pattern(1)
    if kind == "DEAD":  # it has had its power
        assert card.read(2) == pattern(2)


def test_a_card_that_is_dead_at_first_comes_up_later(fresh: Card) -> None:
    fresh.fault("DEAD", for_ns=100 * MS)
    for _ in range(4):
        fresh.send(10)
        fresh.select()
        assert fresh.send(fresh.frame(0) + b"\xff" * 8)[-8:] == b"\xff" * 8
        fresh.deselect()
    fresh.now = 100 * MS - 60_000  # alive from within the clocks on
    fresh.send(10)
    fresh.select()
    assert fresh.send(fresh.frame(0) + b"\xff" * 8)[-8:] == b"\xff" * 8
    fresh.deselect()
    fresh.power_up()


def test_a_slow_card_is_busy_for_as_long_as_asked(card: Card) -> None:
    address = card.address(1)
    card.fault("SLOW", from_ns=card.now, for_ns=MS, ms=250)
    card.r1(24, address)
    assert card.put(pattern(1)) == ACCEPTED
    card.send(1)
    card.wait(249)
    assert card.send(1) == b"\x00"
    card.wait(1)
    card.ready()
    card.write(1, pattern(2))
    card.send(1)
    card.wait(41)
    assert not card.is_busy()
    assert lib.sdcard_chip_busy_worst_ns(card.chip) == 250 * MS


def test_a_slow_card_can_be_slower_than_the_document_lets_it(card: Card) -> None:
    card.fault("SLOW", first=2, count=1, ms=1500)
    card.write(1, pattern(1))
    card.ready()
    card.write(1, pattern(2))
    card.send(1)
    card.wait(1499)
    assert card.is_busy()
    card.wait(1)
    assert not card.is_busy()


@pytest.mark.parametrize(
    ("kind", "response", "status"), [("CRC", CRC_ERROR, 0), ("ERROR", WRITE_ERROR, 4)]
)
def test_blocks_are_rejected_as_asked(
    card: Card, kind: str, response: int, status: int
) -> None:
    card.fault(kind, first=2, count=2)
    responses = []
    for number in range(5):
        responses.append(card.write(number, pattern(number)))
        card.ready()
    assert responses == [ACCEPTED, response, response, ACCEPTED, ACCEPTED]
    assert card.stored(1, 2) == bytes(2 * BLOCK)
    assert card.command(13, more=1) == bytes([0, status])
    assert lib.sdcard_chip_bad_crc(card.chip) == (2 if kind == "CRC" else 0)
    card.fault(kind, from_ns=card.now + MS, for_ns=MS)
    assert card.write(6, pattern(6)) == ACCEPTED
    card.ready()


def test_a_rejected_block_of_a_run_is_told_and_the_rest_is_there(card: Card) -> None:
    card.fault("CRC", first=3, count=1)
    card.r1(25, card.address(0))
    responses = []
    for number in range(3):
        responses.append(card.put(pattern(number), 0xFC))
        card.ready()
    assert responses == [ACCEPTED, ACCEPTED, CRC_ERROR]
    assert card.r1(12) == 0
    card.ready()
    assert card.stored(0, 3) == pattern(0) + pattern(1) + bytes(BLOCK)


def test_a_worn_block_refuses(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_REFUSES)
    responses = []
    for number in range(9, 13):
        responses.append(card.write(number, pattern(number)))
        card.ready()
    assert responses == [ACCEPTED, WRITE_ERROR, WRITE_ERROR, ACCEPTED]


def test_a_worn_block_keeps_what_it_has(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_KEEPS)
    card.write_run(9, *[pattern(number) for number in range(9, 13)])
    assert card.stored(9, 4) == pattern(9) + bytes(2 * BLOCK) + pattern(12)


def test_a_worn_block_can_not_be_read(card: Card) -> None:
    card.fault("WORN", block=10, blocks=2, wear=lib.SDCARD_CHIP_UNREADABLE)
    assert card.write(10, pattern(10)) == ACCEPTED
    card.ready()
    assert card.r1(17, card.address(10)) == 0
    assert card.token() == 0x04  # SD 7.3.3.3: ECC failed
    assert card.command(13, more=1) == b"\x00\x10"
    assert card.read(9) == bytes(BLOCK)


def test_a_dead_card_says_nothing_and_takes_nothing(card: Card) -> None:
    address = card.address(1)
    card.fault("DEAD", from_ns=card.now + MS, for_ns=50 * MS)
    card.wait(1)
    assert card.send(card.frame(24, address) + b"\xff" * 20) == b"\xff" * 26
    assert card.send(b"\xfe" + pattern(1) + bytes(3)) == b"\xff" * 516
    card.wait(50)
    assert card.stored(1) == bytes(BLOCK)
    card.send(b"\x00")  # amid something that it has not heard begin
    card.deselect()
    card.select()
    assert card.r1(13) == 0
    card.fault("DEAD", from_ns=card.now)
    card.wait(100_000)
    assert card.send(card.frame(0) + b"\xff" * 20) == b"\xff" * 26


def test_there_is_room_for_32_faults(card: Card) -> None:
    for _ in range(32):
        card.fault("CRC", first=1000, count=1)
    fault = ffi.new("struct sdcard_chip_fault *")
    assert not lib.sdcard_chip_add_fault(card.chip, fault)
    lib.sdcard_chip_clear_faults(card.chip)
    card.fault("CRC", first=1, count=1)
    assert card.write(0, pattern(0)) == CRC_ERROR


# Power


def kind_of(stands: bytes, old: bytes, new: bytes) -> str:
    """What a cut has made of a block: new up to somewhere, then one of three."""
    if stands == old:
        return "old"
    if stands == new:
        return "new"
    kept = next(i for i in range(BLOCK) if stands[i] != new[i])
    if stands[kept:] in (old[kept:], b"\xff" * (BLOCK - kept)):
        return "torn"
    # Noise: hardly a byte as it was.
    same = sum(a == b for a, b in zip(stands[kept:], old[kept:], strict=True))
    assert same <= 3 + (BLOCK - kept) // 64
    return "torn"


def test_a_block_that_power_leaves_amid_is_old_new_or_torn_200_times(
    tmp_path: Path,
) -> None:
    seen = {"old": 0, "new": 0, "torn": 0}
    for seed in range(200):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 10 * BLOCK)
        assert card.write(2, pattern(2)) == ACCEPTED
        card.ready()
        assert card.write(3, pattern(3)) == ACCEPTED
        card.send(1)
        card.now += seed * 1400  # within the 0.3 ms that busy is at least
        card.cut()
        assert card.stored(2) == pattern(2)  # its busy was over
        seen[kind_of(card.stored(3), b"\x55" * BLOCK, pattern(3))] += 1
        assert card.stored(0, 2) == b"\x55" * 2 * BLOCK
        assert card.stored(4, 6) == b"\x55" * 6 * BLOCK
        assert card.send(8) == b"\xff" * 8
        assert card.complaint() is None
    assert min(seen.values()) >= 20, seen


def test_a_run_that_power_leaves_amid_loses_at_most_its_last_16_200_times(
    tmp_path: Path,
) -> None:
    torn, shapes = 0, set()
    for seed in range(200):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 60 * BLOCK)
        count = 1 + seed % 40
        card.r1(25, 5 * BLOCK)
        for number in range(count):
            assert card.put(pattern(number), 0xFC) == ACCEPTED
            card.ready()
        # Half of them amid the next block, which was never acknowledged.
        card.send(b"\xff\xfc" + pattern(99)[: seed % 2 * 300])
        card.cut()
        kinds = [
            kind_of(card.stored(5 + i), b"\x55" * BLOCK, pattern(i))
            for i in range(count)
        ]
        assert set(kinds[: max(0, count - 16)]) <= {"new"}
        assert kinds.count("torn") <= 1
        torn += kinds.count("torn")
        shapes.add(tuple(key for key, _ in itertools.groupby(kinds)))
        assert card.stored(5 + count) == b"\x55" * BLOCK
        assert card.complaint() is None
    assert torn > 50
    assert ("new", "torn", "old") in shapes
    assert any(len(shape) > 4 for shape in shapes)  # out of order


def test_a_stopped_run_survives_any_cut(tmp_path: Path) -> None:
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        contents = [pattern(seed + i) for i in range(20)]
        card.write_run(0, *contents)
        card.cut()
        assert card.stored(0, 20) == b"".join(contents)


def test_a_cut_leaves_an_erasure_undone_from_somewhere(tmp_path: Path) -> None:
    left = set()
    for seed in range(20):
        card = Card(tmp_path, seed=seed).identify()
        with card.path.open("r+b") as file:
            file.write(b"\x55" * 60 * BLOCK)
        card.r1(32, 10 * BLOCK)
        card.r1(33, 29 * BLOCK)
        card.r1(38)
        card.send(1)
        card.cut()
        whole = card.stored(0, 60)
        zeros = whole.count(0) // BLOCK
        assert whole[10 * BLOCK :].startswith(bytes(zeros * BLOCK))
        left.add(20 - zeros)
    assert len(left) > 8
    assert max(left) <= 20


def test_a_supply_that_dips_is_power_up(card: Card) -> None:
    card.write(1, pattern(1))
    card.ready()
    lib.sdcard_chip_power_cycle(card.chip, card.now)
    card.select(on=False)
    card.hz = SLOW
    card.wait(1)
    card.identify()
    assert card.read(1) == pattern(1)


def test_a_run_s_end_lets_it_finish(card: Card) -> None:
    card.r1(25, card.address(0))
    card.put(pattern(0), 0xFC)
    lib.sdcard_chip_finish(card.chip, card.now)
    assert card.stored(0) == pattern(0)


def test_two_cards_of_a_seed_do_the_same_and_others_do_not(tmp_path: Path) -> None:
    def story(seed: int) -> tuple[bytes, int]:
        card = Card(tmp_path, seed=seed).identify()
        told = bytearray()
        for number in range(20):
            card.r1(25, 0)
            for _ in range(3):
                told.append(card.put(pattern(number), 0xFC))
                card.ready()
            card.stop()
            told += card.read(0)
        return bytes(told), card.now

    assert story(1) == story(1)
    assert story(1)[1] != story(2)[1]


# On the virtual STM32F405


def made(folder: Path, size: int = 1 << 20) -> Path:
    path = folder / "card.img"
    with path.open("wb") as file:
        file.truncate(size)
    return path


def numbered(block: int) -> bytes:
    """What the program writes: bytes that follow from block and place."""
    return bytes((block * 7 + i * 13 + (i >> 8)) & 0xFF for i in range(BLOCK))


@pytest.mark.parametrize(
    ("more", "ocr"),
    [((), 0x80FF8000), (("--card-kind", "sdhc"), 0xC0FF8000)],
)
def test_a_program_writes_and_reads_back_by_dma(
    tmp_path: Path, more: tuple[str, ...], ocr: int
) -> None:
    path = made(tmp_path)
    said = bare.run("sdcard", tmp_path, "--card", str(path), *more)
    lines = said.lines
    assert lines["idle"] == [1]
    assert lines["echo"] == [0x1AA]
    assert lines["ocr"] == [ocr]
    assert lines["r1"] == [0, 0]  # CMD24, CMD25
    assert lines["response"] == [5] * 5
    assert lines["same"] == [1] * 5
    content = path.read_bytes()
    assert content[40 * BLOCK : 45 * BLOCK] == b"".join(map(numbered, range(40, 45)))
    assert content.count(0, 0, 40 * BLOCK) == 40 * BLOCK
    summary = said.summary
    assert summary["card_blocks"] == 5
    assert summary["card_bad_crc"] == 0
    assert 300 <= summary["card_busy_worst_us"] <= 40_000
    assert summary["card_complaint"] is None
    assert summary["firmware_complaint"] is None


def test_two_runs_with_a_card_are_the_same_and_seeds_differ(tmp_path: Path) -> None:
    busy = []
    for seed in (1, 1, 2):
        card = ("--card", str(made(tmp_path)), "--seed", str(seed))
        busy.append(bare.run("sdcard", tmp_path, *card).lines["busy_us"])
    assert busy[0] == busy[1] != busy[2]


def test_without_a_card_there_is_none(tmp_path: Path) -> None:
    said = bare.run("sdcard", tmp_path)
    assert said.lines["idle"] == [0xFF]
    assert not [key for key in said.summary if key.startswith("card")]


def test_a_cut_amid_a_block_of_the_card(tmp_path: Path) -> None:
    path = made(tmp_path)
    cut = {"kind": "power_cut", "card_write": 1, "after_us": 200}
    seen = set()
    for seed in range(16):
        path.write_bytes(bytes(1 << 20))
        more = (*bare.faults(tmp_path, cut), "--seed", str(seed))
        said = bare.run("sdcard", tmp_path, "--card", str(path), *more, code=0)
        assert said.summary["power_cut"] is True
        assert said.summary["card_blocks"] == 1
        content = path.read_bytes()
        block = content[40 * BLOCK : 41 * BLOCK]
        seen.add(kind_of(block, bytes(BLOCK), numbered(40)))
        assert content.count(0) >= (1 << 20) - BLOCK
    assert len(seen) == 3


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ({"kind": "card_crc", "card_write": 1}, [0x0B]),
        ({"kind": "card_error", "card_write": 1}, [0x0D]),
        ({"kind": "card_worn", "block": 40}, [0x0D]),
        ({"kind": "card_error", "card_write": 3, "card_writes": 2}, [5, 5, 0x0D]),
        ({"kind": "card_pulled", "card_write": 2, "after_us": 5}, [5, 5, 0x1F]),
    ],
)
def test_a_card_s_faults_come_from_the_file(
    tmp_path: Path, fault: dict[str, Any], expected: list[int]
) -> None:
    more = bare.faults(tmp_path, fault)
    said = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert said.lines["response"][: len(expected)] == expected


@pytest.mark.parametrize("kind", ["card_pulled", "card_dead"])
def test_a_card_that_is_not_there_from_the_start(tmp_path: Path, kind: str) -> None:
    more = bare.faults(tmp_path, {"kind": kind})
    said = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert said.lines["idle"] == [0xFF]
    assert said.summary["card_complaint"] is None


def test_a_slow_card_comes_from_the_file(tmp_path: Path) -> None:
    more = bare.faults(tmp_path, {"kind": "card_slow", "ms": 120})
    said = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert said.summary["card_busy_worst_us"] == 120_000
    assert said.lines["busy_us"][0] == pytest.approx(120_000, abs=20)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--card-kind", "sdhc"), "--card FILE"),
        (("--card", "card.img", "--card-kind", "mmc"), "sdsc or sdhc"),
        (("--card", "odd.img"), "multiple of 512"),
        (("--card", "none.img"), "no file"),
        (("--faults", "faults.json"), "is for a card: --card FILE"),
    ],
)
def test_options_that_make_no_card_are_told(
    tmp_path: Path, options: tuple[str, ...], told: str
) -> None:
    made(tmp_path)
    (tmp_path / "odd.img").write_bytes(bytes(1000))
    bare.faults(tmp_path, {"kind": "power_cut", "card_write": 1})
    image = bare.image("sdcard", tmp_path)
    done = subprocess.run(
        [bare.emulator(), "--image", image, *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert told in done.stderr


def test_a_rate_beyond_the_card_s_is_a_complaint(tmp_path: Path) -> None:
    said = bare.run("sdcard_fast", tmp_path, "--card", str(made(tmp_path)))
    assert "400 kHz" in said.summary["card_complaint"]
    assert "on the card's bus" in said.errors
