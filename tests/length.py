# SPDX-License-Identifier: MIT
"""How much a test does: a part of it on every run, all of it in `make test-long`.

Such a test has the mark `long`, by which `make test-long` finds it.
"""

from __future__ import annotations

import os
from typing import TypeVar

T = TypeVar("T")

IS_LONG = os.environ.get("IMU_LONG") == "1"


def choose(*, everyday: T, long: T) -> T:
    """As many examples, seconds or cases as this run has time for."""
    return long if IS_LONG else everyday
