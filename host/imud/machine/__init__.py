# SPDX-License-Identifier: MIT
"""What differs between kinds of operating systems, chosen once: POSIX, as Linux and
macOS, and others, as Windows. Both modules have the same functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING or fcntl is not None:
    from imud.machine.posix import (
        PORT_ERRORS,
        SerialWatch,
        cpu_seconds,
        drop_unsent,
        free_bytes,
        host_clock_ns,
        is_administrator,
        keep_others_out,
        keys_of,
        make_ours,
        on_signals,
        raise_files_limit,
        read_keys,
        sync,
        try_lock,
        wait_lock,
    )
else:
    from imud.machine.other import (
        PORT_ERRORS,
        SerialWatch,
        cpu_seconds,
        drop_unsent,
        free_bytes,
        host_clock_ns,
        is_administrator,
        keep_others_out,
        keys_of,
        make_ours,
        on_signals,
        raise_files_limit,
        read_keys,
        sync,
        try_lock,
        wait_lock,
    )

__all__ = [
    "PORT_ERRORS",
    "SerialWatch",
    "cpu_seconds",
    "drop_unsent",
    "free_bytes",
    "host_clock_ns",
    "is_administrator",
    "keep_others_out",
    "keys_of",
    "make_ours",
    "on_signals",
    "raise_files_limit",
    "read_keys",
    "sync",
    "try_lock",
    "wait_lock",
]
