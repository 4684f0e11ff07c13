# SPDX-License-Identifier: MIT
"""The daemon's journal on stderr: format, limits and phrases of its lines."""

from imud.journal.handler import handler

__all__ = ["handler"]
