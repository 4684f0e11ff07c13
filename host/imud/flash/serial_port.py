# SPDX-License-Identifier: MIT
"""Serial ports to bootloaders, and the reset by DTR that starts that of a Nano."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

import serial

from imud.errors import FlashError, reason

# An Arduino's capacitor turns DTR's edge into a reset of 0.1 ms.
RESET_S = 0.05
READ_S = 0.02  # how long a read waits for more
WRITE_S = 2.0  # timeout of a port that takes no bytes


@contextlib.contextmanager
def opened(
    port: str, baud: int, *, parity: str = serial.PARITY_NONE
) -> Iterator[serial.Serial]:
    """An open port. FlashError with what to do if it can't be opened or is lost."""
    with (
        _told(port),
        serial.Serial(
            port,
            baud,
            parity=parity,
            timeout=READ_S,
            write_timeout=WRITE_S,
            exclusive=True,
        ) as found,
    ):
        yield found


@contextlib.contextmanager
def reset(port: str, baud: int) -> Iterator[serial.Serial]:
    """An open port, whose board was reset as it was opened."""
    with opened(port, baud) as found:
        # A pty has no such line, and a virtual board is reset by being opened.
        with contextlib.suppress(OSError):
            found.dtr = False
            time.sleep(RESET_S)
            found.dtr = True
        yield found


@contextlib.contextmanager
def _told(port: str) -> Iterator[None]:
    try:
        yield
    except serial.SerialTimeoutException as error:
        raise FlashError(f"{port} takes no bytes; plug the board in again") from error
    except (BrokenPipeError, UnicodeEncodeError):
        raise  # of what was printed, or of an argument
    except (OSError, ValueError) as error:  # a SerialException is an OSError
        if getattr(error, "filename", None) not in (None, port):
            raise  # of another file
        raise FlashError(
            f"{port} can't be used or was lost: {reason(error)}"
        ) from error
