# SPDX-License-Identifier: MIT
"""Lines for people on stderr: how they look, how often, in which words."""

from imud.journal.handler import handler

__all__ = ["handler"]
