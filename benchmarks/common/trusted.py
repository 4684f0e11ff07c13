# SPDX-License-Identifier: MIT
"""Params of sensors that somebody has calibrated, and virtual boards that have them:
names for benchmarks.
"""

from __future__ import annotations

from imud.params.trusted import CALIBRATED, known_to
from imud.virtual.memory import memory_with, orders_us

__all__ = ["CALIBRATED", "known_to", "memory_with", "orders_us"]
