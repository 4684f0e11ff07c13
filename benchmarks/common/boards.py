# SPDX-License-Identifier: MIT
"""The boards that are measured: their names, images, clocks and sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace

from benchmarks.common import feed
from benchmarks.common.feed import Chip


@dataclass(frozen=True, slots=True)
class Board:
    """A virtual board and its image."""

    name: str  # in `imud sim`, and of the image among the engines
    title: str  # of its processor
    environment: str  # of platformio.ini, which builds its image
    clock_hz: float
    chip: Chip


NANO = Board("nano", "ATmega328P", "nano", 16e6, feed.MPU9250)
MEGA = Board("mega", "ATmega2560", "mega", 16e6, replace(feed.MPU9250, board="mega"))
F405 = Board("f405", "STM32F405", "stm32f405", 168e6, feed.LSM9DS0)
BOARDS = {board.name: board for board in (NANO, F405)}
IMAGES = tuple(BOARDS)  # their names among the engines
