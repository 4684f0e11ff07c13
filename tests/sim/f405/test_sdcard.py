# SPDX-License-Identifier: MIT
"""An SD card on the virtual STM32F405: a program that uses it, faults from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import bare
from programs import ran
from sim.chips.sdcard_desk import BLOCK, kind_of

pytestmark = pytest.mark.sampled(2)


def made(folder: Path, size: int = 1 << 20) -> Path:
    path = folder / "card.img"
    with path.open("wb") as file:
        file.truncate(size)
    return path


def numbered(block: int) -> bytes:
    """The data that the program writes: each byte follows from its block and place."""
    return bytes((block * 7 + i * 13 + (i >> 8)) & 0xFF for i in range(BLOCK))


@pytest.mark.parametrize(
    ("more", "ocr"),
    [((), 0x80FF8000), (("--card-kind", "sdhc"), 0xC0FF8000)],
)
def test_a_program_writes_and_reads_back_by_dma(
    tmp_path: Path, more: tuple[str, ...], ocr: int
) -> None:
    path = made(tmp_path)
    output = bare.run("sdcard", tmp_path, "--card", str(path), *more)
    lines = output.lines
    assert lines["idle"] == [1]
    assert lines["echo"] == [0x1AA]
    assert lines["ocr"] == [ocr]
    assert lines["r1"] == [0, 0]  # of CMD24 and CMD25
    assert lines["response"] == [5] * 5
    assert lines["same"] == [1] * 5
    content = path.read_bytes()
    assert content[40 * BLOCK : 45 * BLOCK] == b"".join(map(numbered, range(40, 45)))
    assert content.count(0, 0, 40 * BLOCK) == 40 * BLOCK
    summary = output.summary
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
    output = bare.run("sdcard", tmp_path)
    assert output.lines["idle"] == [0xFF]
    assert not [key for key in output.summary if key.startswith("card")]


@pytest.mark.nightly
def test_a_cut_amid_a_block_of_the_card(tmp_path: Path) -> None:
    path = made(tmp_path)
    cut = {"kind": "power_cut", "card_write": 1, "after_us": 200}
    seen = set()
    for seed in range(16):
        path.write_bytes(bytes(1 << 20))
        more = (*bare.faults(tmp_path, cut), "--seed", str(seed))
        output = bare.run("sdcard", tmp_path, "--card", str(path), *more, code=0)
        assert output.summary["power_cut"] is True
        assert output.summary["card_blocks"] == 1
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
    output = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert output.lines["response"][: len(expected)] == expected


@pytest.mark.parametrize("kind", ["card_pulled", "card_dead"])
def test_a_card_that_is_not_there_from_the_start(tmp_path: Path, kind: str) -> None:
    more = bare.faults(tmp_path, {"kind": kind})
    output = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert output.lines["idle"] == [0xFF]
    assert output.summary["card_complaint"] is None


def test_a_slow_card_comes_from_the_file(tmp_path: Path) -> None:
    more = bare.faults(tmp_path, {"kind": "card_slow", "ms": 120})
    output = bare.run("sdcard", tmp_path, "--card", str(made(tmp_path)), *more)
    assert output.summary["card_busy_worst_us"] == 120_000
    assert output.lines["busy_us"][0] == pytest.approx(120_000, abs=20)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--card-kind", "sdhc"), "--card FILE"),
        (("--card", "card.img", "--card-kind", "mmc"), "sdsc or sdhc"),
        (("--card", "odd.img"), "multiple of 512"),
        (("--card", "none.img"), "no file"),
        (("--faults", "faults.json"), "is for a card: --card FILE"),
    ],
)
def test_options_that_make_no_card_are_told(
    tmp_path: Path, options: tuple[str, ...], expected: str
) -> None:
    made(tmp_path)
    (tmp_path / "odd.img").write_bytes(bytes(1000))
    bare.faults(tmp_path, {"kind": "power_cut", "card_write": 1})
    image = bare.image("sdcard")
    done = ran(bare.emulator(), "--image", image, *options, cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr


def test_a_rate_beyond_the_card_s_is_a_complaint(tmp_path: Path) -> None:
    output = bare.run("sdcard_fast", tmp_path, "--card", str(made(tmp_path)))
    assert "400 kHz" in output.summary["card_complaint"]
    assert "on the card's bus" in output.errors
