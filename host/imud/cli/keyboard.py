# SPDX-License-Identifier: MIT
"""The keys that are pressed while a screen is shown."""

from __future__ import annotations

from imud.machine import system

keys_of = system.keys_of


class Quit(Exception):
    """The user pressed q."""


def pressed(keyboard: int | None) -> str:
    """The keys that were pressed, in lower case; empty if none were. Quit for q, and
    if the terminal was closed.
    """
    if keyboard is None:
        return ""
    keys = system.read_keys(keyboard)
    if keys is None or "q" in keys.lower():
        raise Quit
    return keys.lower()
