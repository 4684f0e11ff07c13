# SPDX-License-Identifier: MIT
"""Differences between operating systems, chosen once: `system` is posix.py on
Linux and macOS, other.py elsewhere, as on Windows. Both have the same names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING or fcntl is not None:
    from imud.machine import posix as system
else:
    from imud.machine import other as system

__all__ = ["system"]
