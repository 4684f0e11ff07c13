# SPDX-License-Identifier: MIT
"""Chooses how much work a test does: a part in `make test`, all in `make test-long`.

Such a test has the mark `long`, by which `make test-long` selects it.
"""

from __future__ import annotations

import os
from typing import TypeVar

T = TypeVar("T")

IS_LONG = os.environ.get("IMU_LONG") == "1"


def choose(*, everyday: T, long: T) -> T:
    """The number of examples, seconds or cases for this kind of run."""
    return long if IS_LONG else everyday
