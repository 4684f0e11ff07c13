# SPDX-License-Identifier: MIT
"""The wire of a probe without the C module: messages to frames that wait to be sent,
received bytes to commands. Nothing is allocated for a message of which there are many.
"""

from time import ticks_us

from micropython import const

from . import wire
from .fast import crc16, decode, encode

_AROUND = const(4)  # bytes of a frame that are not content
_CRC = const(2)
_RECEIVED_MAX = const(64)  # a command's frame, and noise
_HIGHEST = const(0x20000000)  # half of the period of ticks_us

_COMMAND_SIZE = len(wire.COMMAND)  # content


def message(template):
    """Content that can be filled in, with room for a CRC."""
    return bytearray(template + b"\0\0")


def _nothing():
    return 0


def _polled(stream):
    """The method any() of a stream without one, such as a Pico's USB."""
    from select import POLLIN, poll

    poller = poll()
    poller.register(stream, POLLIN)

    def is_there():
        for _ in poller.ipoll(0):
            return True
        return False

    return is_there


class Link:
    """`room`: bytes of frames that may wait."""

    def __init__(self, room):
        self.dropped = 0
        self.bad = 0
        self._sequence = 0
        self._out = bytearray(room)
        self._begin = 0  # of what waits
        self._end = 0
        self._last_ticks = ticks_us()
        self._wraps = 0
        self._received = bytearray(_RECEIVED_MAX)
        self._length = 0
        self._one = bytearray(1)
        self._stream = None
        self._any = _nothing

    @property
    def sent(self):
        return self._sequence - self.dropped

    def _stamp(self, content, ticks):
        """The time of a message, 32 bits of microseconds: ticks have 30."""
        if ticks - self._last_ticks < -_HIGHEST:
            self._wraps += 1
            self._last_ticks = ticks
        elif ticks - self._last_ticks < _HIGHEST and ticks > self._last_ticks:
            self._last_ticks = ticks
        wraps = self._wraps
        if ticks - self._last_ticks > _HIGHEST:
            wraps -= 1  # of before the last wrap
        content[5] = ticks & 0xFF
        content[6] = (ticks >> 8) & 0xFF
        content[7] = (ticks >> 16) & 0xFF
        content[8] = (ticks >> 24) | (wraps & 3) << 6

    def put(self, content, length, ticks):
        """Numbers and frames a message; `content` has room for a CRC behind it."""
        number = self._sequence
        self._sequence = number + 1
        content[1] = number & 0xFF
        content[2] = (number >> 8) & 0xFF
        content[3] = (number >> 16) & 0xFF
        content[4] = (number >> 24) & 0xFF
        if self._end + length + _AROUND > len(self._out):
            self.dropped += 1
            return
        self._stamp(content, ticks)
        seed = wire.HELLO_SEED if content[0] == wire.HELLO[0] else wire.SEED
        self._end = encode(seed, content, length, self._out, self._end)

    def send(self, stream):
        """Writes what waits, as far as the stream takes it; returns what is left."""
        begin = self._begin
        if begin == self._end:
            return 0
        done = stream.write(self._out, begin, self._end - begin)
        if done:
            self._begin = begin + done
            if self._begin == self._end:
                self._begin = self._end = 0
        return self._end - self._begin

    def receive(self, stream):
        """The content of the next command among the bytes that are there, or None."""
        if stream is not self._stream:
            self._stream = stream
            self._any = stream.any if hasattr(stream, "any") else _polled(stream)
        while self._any():
            stream.readinto(self._one)
            byte = self._one[0]
            if byte:
                if self._length < _RECEIVED_MAX:
                    self._received[self._length] = byte
                self._length += 1
                continue
            length, self._length = self._length, 0
            if length and self._is_command(length):
                return self._received
        return None

    def _is_command(self, length):
        received = self._received
        if length > _RECEIVED_MAX or decode(received, length) != _COMMAND_SIZE + _CRC:
            self.bad += 1
            return False
        crc = received[_COMMAND_SIZE] | received[_COMMAND_SIZE + 1] << 8
        is_good = (
            received[0] == wire.COMMAND[0]
            and crc16(wire.SEED, received, _COMMAND_SIZE) == crc
        )
        self.bad += not is_good
        return is_good
