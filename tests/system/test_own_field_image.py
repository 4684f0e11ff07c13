# SPDX-License-Identifier: MIT
"""The image of an F405 keeps its own magnetic field over power-off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud import cli
from imud.virtual import modules
from imud.wire import messages
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message
from twin_bench import run_twin

SEED = 5
LEARNS_S = 900  # of a hand that turns it and lays it down


class Board:
    """An F405 with a module from the shop in that hand, and its flash."""

    def __init__(self, boards: dict[str, tuple[Path, Path]], folder: Path) -> None:
        self._simulator, self._image = boards["f405"]
        self._folder = folder

    def run(self, seconds: float, *more: str) -> list[bytes]:
        path = self._folder / "uart.bin"
        words = ["--simulator", self._simulator, "--image", self._image, "--fast"]
        words += ["--eeprom", self._folder / "flash", "--record", path, "--stream"]
        words += ["--module", "shop", "--hand", "calibrate", "--seed", SEED]
        words += ["--seconds", seconds, *more]
        assert cli.main(["sim", "f405", *map(str, words)]) == 0
        return FrameDecoder().feed(path.read_bytes())


def hellos(contents: list[bytes]) -> list[dict[str, Any]]:
    found = [messages.decode(content) for content in contents]
    return [
        dict(message.fields)
        for message in found
        if isinstance(message, Message) and message.name == "hello"
    ]


@pytest.mark.nightly  # a quarter of an hour of the board
@pytest.mark.timeout(1800)
def test_a_probe_that_was_used_begins_with_its_own_field(
    boards: dict[str, tuple[Path, Path]], tmp_path: Path
) -> None:
    board = Board(boards, tmp_path)
    first = hellos(board.run(LEARNS_S))
    assert first[0]["own_sigma"] == 0.0
    assert first[-1]["own_sigma"] == 3.0
    contents = board.run(20, "--raw", "--rate", "380")
    found = hellos(contents)[0]
    assert found["own_sigma"] == 3.5
    true_ut = modules.named("shop", SEED).mag_bias
    assert np.abs(np.array(found["own_field"]) - true_ut).max() < 6
    twin, _ = run_twin(contents)
    assert twin.compared > 1000
    assert twin.differed == 0
