# SPDX-License-Identifier: MIT
"""The errors of writing a board, beside FlashError itself."""

from __future__ import annotations

from imud.errors import FlashError


class WrongChip(FlashError):
    """It is not the chip that the image is for."""


class HalfWritten(FlashError):
    """Writing ended early: the board has no firmware that runs."""
