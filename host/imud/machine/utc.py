# SPDX-License-Identifier: MIT
"""Whether this machine's clock follows UTC, and how far off it may be: adjtimex(2) says
it, which chrony, ntpd and systemd-timesyncd set and `timedatectl` shows.
"""

from __future__ import annotations

import ctypes
import socket
from collections.abc import Callable
from functools import cache

import msgspec

STA_UNSYNC = 0x0040  # of `status`, linux/timex.h
TIME_ERROR = 5  # the return value of a clock that is not synchronised

# The kernel's bound grows from the last correction on; it is this many us if the clock
# was not corrected for a long time.
MAXERROR_US = 16_000_000


class Sync(msgspec.Struct, frozen=True):
    """How well a host knows UTC. None: its kernel does not say."""

    host: str
    is_synchronised: bool | None = None
    bound_us: int | None = None  # None also where the clock is not synchronised

    @classmethod
    def of(cls, host: str, state: int, status: int, maxerror_us: int) -> Sync:
        """The state of synchronisation, from the result of adjtimex(2)."""
        is_wrong = state == TIME_ERROR or bool(status & STA_UNSYNC)
        if is_wrong or maxerror_us >= MAXERROR_US:
            return cls(host, is_synchronised=False)
        return cls(host, is_synchronised=True, bound_us=maxerror_us)


class _Timex(ctypes.Structure):
    """The first fields of struct timex, and room for the others."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("others", ctypes.c_long * 32),
    )


@cache
def _adjtimex() -> Callable[..., int] | None:
    """The system call; None: this is not Linux."""
    try:
        call: Callable[..., int] = ctypes.CDLL(None).adjtimex
    except (AttributeError, OSError):
        return None
    return call


def sync_of_host() -> Sync:
    """Asks the kernel, which needs no privilege."""
    host = socket.gethostname()
    adjtimex = _adjtimex()
    if adjtimex is None:
        return Sync(host)
    timex = _Timex()
    state = adjtimex(ctypes.byref(timex))
    if state < 0:
        return Sync(host)
    return Sync.of(host, state, timex.status, timex.maxerror)
