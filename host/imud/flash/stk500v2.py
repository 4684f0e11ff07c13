# SPDX-License-Identifier: MIT
"""STK500, version 2: the protocol of an Arduino Mega 2560's bootloader.

Commands and answers are those of Atmel's application note AVR068 ("STK500
Communication Protocol"), of which that bootloader, stk500boot, knows the few below. No
I/O of its own: `wire` is a port.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import reduce
from operator import xor

from imud.errors import FlashError
from imud.flash.stk500 import ANSWER_S, BootWire, NoBootloader

# AVR068, "Message format" and "Command Format".
START, TOKEN = 0x1B, 0x0E
SIGN_ON, LOAD_ADDRESS = 0x01, 0x06
ENTER, LEAVE, CHIP_ERASE = 0x10, 0x11, 0x12
PROGRAM, READ, READ_SIGNATURE = 0x13, 0x14, 0x1B
OK = 0x00
NAME = b"\x08AVRISP_2"
LARGE = 1 << 31  # of an address: of more than 64 KB of flash

# Starts the monitor of older bootloaders wherever it comes (arduino/Arduino 392).
MONITOR = b"!!!"
HEAD = 5  # bytes before a message's body
BODY_MAX = 275  # AVR068, "Message format"
HEARD_MAX = 4096  # bytes at a time, of the firmware's output
# The firmware's output from before the reset ends meanwhile; the bootloader listens for
# a second from the reset on, and much longer after the first command.
BEGIN_S = 0.1
SYNC_S = 0.25
SYNC_TRIES = 4


class Stk500v2:
    """A bootloader that listens, from sync() on. Addresses and sizes are in bytes, and
    even. Each function raises FlashError for a wrong answer.
    """

    def __init__(self, wire: BootWire) -> None:
        self._wire = wire
        self._number = 0

    def sync(self) -> None:
        """Starts a session; NoBootloader if there is no answer."""
        self._hear(BEGIN_S, HEARD_MAX, lambda _: False)
        for _ in range(SYNC_TRIES):
            self._send(bytes((SIGN_ON,)))
            if self._answer(SYNC_S, 2 + len(NAME)) == bytes((SIGN_ON, OK)) + NAME:
                # It ignores these parameters.
                self._ask("the start", bytes((ENTER, *11 * (0,))), 0)
                return
        raise NoBootloader("no bootloader answers")

    def signature(self) -> bytes:
        """Three bytes that name the chip: 1e 98 01 is an ATmega2560."""
        found = b""
        for number in range(3):
            # After which byte of the command that follows the chip answers: Read
            # Signature Byte (ATmega2560, table 30-17).
            command = bytes((READ_SIGNATURE, 4, 0x30, 0, number, 0))
            found += self._ask("the signature", command, 2)[:1]
        return found

    def rewind(self) -> None:
        """From now on pages are erased from the first one on: each write() erases the
        next page, whichever it writes. The command is to erase all; newer bootloaders
        report that it failed.
        """
        self._send(bytes((CHIP_ERASE,)))
        if self._answer(ANSWER_S, 2)[:1] != bytes((CHIP_ERASE,)):
            raise FlashError("the bootloader did not answer for the first page")

    def read(self, address: int, size: int) -> bytes:
        self._load(address)
        command = bytes((READ, size // 256, size % 256, 0x20))
        found = self._ask(f"the bytes at {address:#06x}", command, size + 1)
        return found[:-1]

    def write(self, address: int, page: bytes) -> None:
        """Erases the next page, and writes one."""
        self._load(address)
        # How a programmer would write it, which concerns a chip on its pins.
        how = bytes((0xC1, 10, 0x40, 0x4C, 0x20, 0, 0))
        head = bytes((PROGRAM, len(page) // 256, len(page) % 256))
        self._ask(f"the page at {address:#06x}", head + how + page, 0)

    def leave(self) -> None:
        """Makes it start the image."""
        self._ask("the end", bytes((LEAVE, 1, 1)), 0)

    def _load(self, address: int) -> None:
        words = LARGE | address // 2
        self._ask("the address", bytes((LOAD_ADDRESS,)) + words.to_bytes(4, "big"), 0)

    def _ask(self, what: str, command: bytes, size: int) -> bytes:
        """The answer's bytes after the command and the OK."""
        self._send(command)
        answer = self._answer(ANSWER_S, size + 2)
        if answer[:2] != bytes((command[0], OK)) or len(answer) != size + 2:
            raise FlashError(f"the bootloader did not answer for {what}")
        return answer[2:]

    def _send(self, body: bytes) -> None:
        message = MONITOR
        while MONITOR in message:  # of the checksum, which follows from the number
            self._number = (self._number + 1) % 256
            message = bytes((START, self._number, *len(body).to_bytes(2, "big"), TOKEN))
            message += body
            message += bytes((reduce(xor, message),))
        self._wire.write(message)

    def _answer(self, seconds: float, size: int) -> bytes:
        """The body of the answer to the last message, which is to have that size;
        nothing if none comes. Other bytes may come before it.
        """
        found = b""

        def is_there(heard: bytes) -> bool:
            nonlocal found
            found = _body(heard, self._number)
            return bool(found)

        self._hear(seconds, HEAD + size + 1, is_there)
        return found

    def _hear(
        self, seconds: float, size: int, is_enough: Callable[[bytes], bool]
    ) -> None:
        """`size`: of the answer, so that a read does not wait for more."""
        heard = b""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and not is_enough(heard):
            heard += self._wire.read(max(1, size - len(heard)))


def _body(heard: bytes, number: int) -> bytes:
    """That of the first whole message of this number."""
    begin = bytes((START, number))
    at = heard.find(begin)
    while at >= 0:
        head = heard[at : at + HEAD]
        size = int.from_bytes(head[2:4], "big")
        message = heard[at : at + HEAD + size + 1]
        is_whole = len(message) == HEAD + size + 1 and size <= BODY_MAX
        if is_whole and head[4] == TOKEN and reduce(xor, message) == 0:
            return message[HEAD:-1]
        at = heard.find(begin, at + 1)
    return b""
