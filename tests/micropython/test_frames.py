# SPDX-License-Identifier: MIT
"""The frames of MicroPython, plain and viper, are those of the C."""

from __future__ import annotations

from pathlib import Path

import pytest

from micropython_frames import assert_frames_are_those_of_c
from micropython_tape import Command

pytestmark = pytest.mark.long


def test_plain_viper_and_c_make_the_same_frames(
    micropython: Command, tmp_path: Path
) -> None:
    assert_frames_are_those_of_c(micropython, 10_000, tmp_path)
