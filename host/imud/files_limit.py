# SPDX-License-Identifier: MIT
"""How many files and connections a process may have open."""

from __future__ import annotations

import contextlib
import resource


def raise_files_limit() -> int:
    """Takes as many as the system allows at most, and says how many: the usual limit
    of 1,024 is for programs that use select().
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        return hard
    return soft
