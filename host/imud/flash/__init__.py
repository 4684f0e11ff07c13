# SPDX-License-Identifier: MIT
"""Writes firmware into boards, by the bootloader that each of them has."""

from __future__ import annotations

from collections.abc import Callable

# How many steps of how many are done.
OnProgress = Callable[[int, int], None]
