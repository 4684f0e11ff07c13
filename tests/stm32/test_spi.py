# SPDX-License-Identifier: MIT
"""The card's bus, driver and log on the virtual STM32F405 with the model of a card in
its socket: card/card_test.c logs for two seconds and prints the time that it took."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from core.fake_card import BLOCK
from core.log_desk import CAUSES, STATES, Volume, frames_of, read
from programs import ran
from stm32.programs import FLOAT_ABIS, board_program

STEP_US_MAX = 20
LOG_S = 2
RATE_HZ = 380
CARD_BLOCKS = 68 * 1024


@pytest.fixture(scope="module", params=FLOAT_ABIS)
def program(root: Path, request: pytest.FixtureRequest) -> Path:
    return board_program(request.param, [root / "tests/stm32/card/card_test.c"])


class Run:
    """Its output, and the card behind it."""

    def __init__(self, lines: list[str], summary: dict[str, Any]) -> None:
        self.summary = summary
        self.numbers: dict[str, list[int]] = {}
        for line in lines:
            word, number = line.split()
            self.numbers.setdefault(word, []).append(int(number))

    def __getitem__(self, word: str) -> int:
        return self.numbers[word][-1]


@pytest.fixture
def run(program: Path, f405: Path, tmp_path: Path) -> Callable[..., Run]:
    def run(
        volume: Volume | None,
        *options: str,
        faults: list[dict[str, Any]] | None = None,
        seconds: float = 6,
    ) -> Run:
        record, summary, card = (tmp_path / n for n in ("record", "summary", "card"))
        (tmp_path / "faults").write_text(json.dumps(faults or []), encoding="ascii")
        command: list[str | Path] = [
            *(f405, "--image", program, "--record", record, "--summary", summary),
            *("--fast", "--seconds", str(seconds), "--faults", tmp_path / "faults"),
        ]
        if volume is not None:
            with card.open("wb") as file:
                file.truncate(CARD_BLOCKS * BLOCK)
                for number, block in volume.content.items():
                    file.seek(number * BLOCK)
                    file.write(block)
            command += ["--card", card, *options]
        done = ran(*command)
        assert done.returncode == 0, done.stderr
        figures = json.loads(summary.read_text(encoding="ascii"))
        assert figures["firmware_complaint"] is None
        if volume is not None:
            with card.open("rb") as file:
                file.seek(volume.file * BLOCK)
                for number in range(volume.file, volume.file + volume.blocks):
                    volume.content[number] = file.read(BLOCK)
        text = record.read_text(encoding="ascii").replace("\0", "")
        return Run(text.splitlines(), figures)

    return run


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["sdhc", "sdsc"])
def test_a_log_is_on_the_card_and_no_step_takes_long(
    run: Callable[..., Run], kind: str
) -> None:
    volume = Volume(600)
    result = run(volume, "--card-kind", kind)
    assert STATES[result["state"]] == "ready"
    assert result["faults"] == 0
    assert result["dropped"] == 0
    assert LOG_S * RATE_HZ <= result["kept"] <= LOG_S * RATE_HZ + 2
    frames = frames_of(read(volume)[1])
    assert [int(frame[:8]) for frame in frames] == [*range(1, result["kept"] + 1)]
    assert result["longest"] <= STEP_US_MAX


@pytest.mark.nightly
def test_an_empty_socket_costs_nothing_but_looks(run: Callable[..., Run]) -> None:
    result = run(None)
    assert STATES[result["state"]] == "absent"
    assert [CAUSES[cause] for cause in result.numbers["fault"]] == ["absent"]
    assert result["longest"] <= STEP_US_MAX
    # 3000 ticks, and a few exchanges a second.
    assert result["steps"] < 3100


def test_a_garbled_block_is_sent_again(run: Callable[..., Run]) -> None:
    volume = Volume(600)
    result = run(volume, faults=[{"kind": "card_crc", "card_write": 5}])
    assert result["faults"] == 1
    frames = frames_of(read(volume)[1])
    assert [int(frame[:8]) for frame in frames] == [*range(1, result["kept"] + 1)]
