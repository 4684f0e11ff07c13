# SPDX-License-Identifier: MIT
"""The log over the model of a card that sim/chips has of the specification: what each
took from the document fits together."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from core.fake_card import BLOCK, FakeCard
from core.fake_spi import FAST_HZ, SLOW_HZ, Wire
from core.log_desk import (
    LOST_US_MAX,
    SECOND,
    Log,
    Volume,
    ffi,
    frames_of,
    lib,
    loss,
    read,
)
from length import choose

pytestmark = pytest.mark.sampled(4)

# 34 MB
BLOCKS = 68 * 1024
KINDS = {
    "sdhc": lib.SDCARD_CHIP_SDHC,
    "sdsc": lib.SDCARD_CHIP_SDSC,
    "version 1": lib.SDCARD_CHIP_SDSC,
}


class Chip(FakeCard):
    """The model in the place of the fake."""

    def __init__(self, image: Path, kind: str, seed: int) -> None:
        super().__init__()
        self.image = image
        self._path = ffi.new("char[]", str(image).encode())
        config = ffi.new(
            "struct sdcard_chip_config *",
            {
                "image": self._path,
                "kind": KINDS[kind],
                "is_version_1": kind == "version 1",
                "seed": seed,
            },
        )
        problem = ffi.new("char **")
        self.chip = lib.sdcard_chip_new(config, problem)
        assert self.chip != ffi.NULL, ffi.string(problem[0])

    def exchange(self, out: bytes, start_us: float, byte_us: float, **_: Any) -> bytes:
        self.now_us = start_us
        clock_hz = SLOW_HZ if byte_us > 1 else FAST_HZ
        answer = bytearray()
        for i, byte in enumerate(out):
            now_ns = int((start_us + (i + 1) * byte_us) * 1000)
            answer.append(lib.sdcard_chip_exchange(self.chip, now_ns, clock_hz, byte))
        return bytes(answer)

    def fault(self, kind: str, **more: Any) -> None:
        name = getattr(lib, f"SDCARD_CHIP_{kind.upper()}")
        fault = ffi.new("struct sdcard_chip_fault *", {"kind": name, **more})
        assert lib.sdcard_chip_add_fault(self.chip, fault)

    @property
    def complaint(self) -> str | None:
        text = lib.sdcard_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()


class ChipWire(Wire):
    """Whose select reaches the model."""

    def _select(self, _: Any, is_selected: bool) -> None:
        super()._select(_, is_selected)
        lib.sdcard_chip_select(self.card.chip, int(self.now_us * 1000), is_selected)


class Bench:
    """A volume in a file, the model over it, the log on the model."""

    def __init__(self, folder: Path, kind: str, seed: int, blocks: int) -> None:
        self.volume = Volume(blocks)
        self.image = folder / "card"
        with self.image.open("wb") as file:
            file.truncate(BLOCKS * BLOCK)
            for number, block in self.volume.content.items():
                file.seek(number * BLOCK)
                file.write(block)
        self.card = Chip(self.image, kind, seed)
        self.log = Log(self.card, wire=ChipWire(ffi, self.card))

    def restart(self) -> Log:
        """The host's start; the card continues."""
        self.log = Log(self.card, wire=ChipWire(ffi, self.card))
        return self.log

    def finish(self) -> Volume:
        """The volume as it stands behind all that the card has promised."""
        lib.sdcard_chip_finish(self.card.chip, int(self.log.now_us * 1000))
        return self.look()

    def look(self) -> Volume:
        first = self.volume.file
        with self.image.open("rb") as file:
            file.seek(first * BLOCK)
            for number in range(first, first + self.volume.blocks):
                self.volume.content[number] = file.read(BLOCK)
        return self.volume


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Any]:
    made: list[Bench] = []

    def make(kind: str = "sdhc", seed: int = 1, blocks: int = 800) -> Bench:
        made.append(Bench(tmp_path, kind, seed, blocks))
        return made[-1]

    yield make
    for each in made:
        lib.sdcard_chip_free(each.card.chip)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(choose(everyday=2, long=5)))
def test_what_is_put_in_is_on_the_card(bench, kind, seed):
    it = bench(kind, seed)
    it.log.until("ready").open().log(2 * SECOND).close()
    assert it.card.complaint is None
    assert it.log.dropped == 0
    assert it.log.status.card_faults == 0
    assert lib.sdcard_chip_bad_crc(it.card.chip) == 0
    assert frames_of(read(it.finish())[1]) == it.log.kept


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(choose(everyday=3, long=30)))
def test_a_cut_loses_half_a_second_at_most_and_the_rest_is_gone_on_with(
    bench, kind, seed
):
    chance = random.Random(seed)  # noqa: S311, no secret
    it = bench(kind, seed)
    it.log.until("ready").open().log(chance.uniform(1000, 1_200_000))
    for _ in range(chance.randrange(8)):
        it.log.step()
    lib.sdcard_chip_power_cycle(it.card.chip, int(it.log.now_us * 1000))
    assert it.card.complaint is None
    assert loss(it.look(), it.log.put, 1, it.log.now_us) < LOST_US_MAX
    before = read(it.volume).get(1, [])
    it.log.wire.now_us += 2000
    it.card.now_us = it.log.now_us
    again = it.restart().until("ready").open().log(200_000).close()
    found = read(it.finish())
    assert frames_of(found[2 if before else 1]) == again.kept
    assert found.get(1, []) == before or not before
    assert it.card.complaint is None


@pytest.mark.long
@pytest.mark.parametrize("seed", range(choose(everyday=3, long=20)))
def test_a_reset_of_the_host_amid_anything_is_gone_on_from(bench, seed):
    chance = random.Random(seed)  # noqa: S311, no secret
    it = bench("sdhc", seed)
    it.log.until("ready").open().log(chance.uniform(1000, 600_000))
    for _ in range(chance.randrange(30)):
        it.log.step()
    lib.sdcard_chip_host_reset(it.card.chip, int(it.log.now_us * 1000))
    it.card.now_us = it.log.now_us
    again = it.restart().until("ready").open().log(200_000).close()
    found = read(it.finish())
    assert frames_of(found[max(found)]) == again.kept
    assert it.card.complaint is None


def test_a_pulled_card_is_taken_back(bench):
    it = bench()
    log = it.log.until("ready").open().log(500_000)
    it.card.fault("pulled", from_ns=int(log.now_us * 1000), for_ns=3 * 10**9)
    while log.state == "logging":
        log.log(20_000)
    assert log.state == "absent"
    log.until("ready").open()
    log.put.clear()
    log.log(300_000).close()
    assert frames_of(read(it.finish())[2]) == log.kept


def test_a_slow_busy_is_ridden_out(bench):
    it = bench()
    log = it.log.until("ready").open().log(500_000)
    it.card.fault("slow", from_ns=int(log.now_us * 1000), for_ns=10**6 * 100, ms=250)
    log.log(1_500_000).close()
    assert log.dropped == 0
    assert ("card_fault", "late") in [change[:2] for change in log.changes]
    assert frames_of(read(it.finish())[1]) == log.kept


@pytest.mark.parametrize("kind", ["crc", "error"])
def test_a_refused_block_is_written_again(bench, kind):
    it = bench()
    it.card.fault(kind, first=9, count=2)
    log = it.log.until("ready").open().log(SECOND).close()
    assert frames_of(read(it.finish())[1]) == log.kept
    assert log.status.card_faults == 2
    assert it.card.complaint is None


@pytest.mark.parametrize("wear", ["refuses", "unreadable"])
def test_a_worn_place_is_left_behind(bench, wear):
    it = bench()
    it.card.fault(
        "worn",
        block=it.volume.file + 20,
        blocks=3,
        wear=getattr(lib, f"SDCARD_CHIP_{wear.upper()}"),
    )
    log = it.log.until("ready").open().log(SECOND).close()
    found = read(it.finish())[1]
    assert frames_of(found) == log.kept
    worn = [change[2] for change in log.changes if change[1] == "worn"]
    assert worn == ([20, 21, 22] if wear == "refuses" else [])
    it.card.now_us = log.now_us
    assert it.restart().until("ready").status.card_block == log.status.card_block


def test_a_dead_card_ends_the_recording(bench):
    it = bench()
    log = it.log.until("ready").open().log(300_000)
    it.card.fault("dead", from_ns=int(log.now_us * 1000))
    for _ in range(100):
        log.log(100_000)
    assert log.state == "absent"
    assert log.changes[-2][:2] == ("log_ended", "absent")
