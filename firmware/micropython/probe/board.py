# SPDX-License-Identifier: MIT
"""The fields of a board in `hello`."""

import sys

import machine

from micropython import const

_MICROPYTHON = const(3)  # enum board of the protocol
_FIRMWARE_MAX = const(16)  # characters

# Flags of the protocol's reset_cause, by the names of machine's constants.
_CAUSES = (
    ("PWRON_RESET", 1),
    ("HARD_RESET", 2),
    ("BROWN_OUT_RESET", 4),
    ("WDT_RESET", 8),
    ("SOFT_RESET", 16),
)


def firmware():
    """MicroPython, its version and its port, as in "mpy 1.29 pyboard"."""
    version = sys.implementation.version
    return "mpy {}.{} {}".format(version[0], version[1], sys.platform)[:_FIRMWARE_MAX]


def reset_cause():
    """Flags of the protocol's reset_cause; 0: not known."""
    cause = machine.reset_cause()
    for name, flag in _CAUSES:
        if cause == getattr(machine, name, None):
            return flag
    return 0


def facts():
    """The arguments of Probe() that describe the board."""
    hz = machine.freq()
    if isinstance(hz, tuple):  # stm32: of the processor first, then of its buses
        hz = hz[0]
    return {
        "id": machine.unique_id(),
        "firmware": firmware(),
        "board": _MICROPYTHON,
        "reset_cause": reset_cause(),
        "mhz": hz // 1_000_000,
    }
