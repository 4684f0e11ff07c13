# SPDX-License-Identifier: MIT
"""The keys that are pressed while a screen is shown."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import tty
from collections.abc import Iterator
from typing import TextIO


class Quit(Exception):
    """The user pressed q."""


@contextlib.contextmanager
def keys_of(source: TextIO) -> Iterator[int | None]:
    """The descriptor of a keyboard that passes each key on at once. None if `source` is
    not a terminal.
    """
    if not source.isatty():
        yield None
        return
    descriptor = source.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def pressed(keyboard: int | None) -> str:
    """The keys that were pressed, in lower case; empty if none were. Quit for q, and
    if the terminal was closed.
    """
    if keyboard is None or not select.select([keyboard], [], [], 0)[0]:
        return ""
    keys = os.read(keyboard, 64).decode(errors="replace").lower()
    if not keys or "q" in keys:
        raise Quit
    return keys
