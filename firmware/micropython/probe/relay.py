# SPDX-License-Identifier: MIT
"""Wires whose write() is of MicroPython."""

from time import ticks_diff, ticks_ms

from micropython import const

_ABSENT_MS = const(500)  # a wire that takes nothing for so long has nobody to read it
_BUFFER = const(512)


class Relay:
    """The module writes to streams of C alone: its bytes are taken from it. A subclass
    has write(data, at, length), which returns how many bytes it is done with.
    """

    def __init__(self):
        self._buffer = bytearray(_BUFFER)
        self._begin = 0
        self._end = 0

    def write(self, data, at, length):
        # Abstract: MicroPython has no module abc. UDP and Tee have their own.
        raise NotImplementedError

    def sender(self, probe):
        """The replacement of probe.send, with this object."""
        take = getattr(probe, "take", None)
        return probe.send if take is None else lambda _: self._relay(take)

    def _relay(self, take):
        if self._begin == self._end:
            self._begin = 0
            self._end = take(self._buffer)
        if self._begin < self._end:
            length = self._end - self._begin
            self._begin += self.write(self._buffer, self._begin, length)
        return self._end - self._begin


class Tee(Relay):
    """A wire whose bytes also go to a log. The log continues if nobody reads the wire,
    such as a USB port without a host: those bytes are dropped from the wire.
    """

    def __init__(self, wire, log):
        super().__init__()
        self._wire = wire
        self._log = log
        self._moved_ms = ticks_ms()

    def write(self, data, at, length):
        """Bytes that are done with, from `at` on."""
        done = self._wire.write(data, at, length) or 0
        now_ms = ticks_ms()
        if done:
            self._moved_ms = now_ms
        elif ticks_diff(now_ms, self._moved_ms) >= _ABSENT_MS:
            done = length
        self._log.write(data, at, done)
        return done
