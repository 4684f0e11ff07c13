# SPDX-License-Identifier: MIT
"""The message `status` of a probe without the C module."""

import struct

from . import wire
from .link import message

_SEEN = (
    wire.STATUS_UPTIME,
    wire.STATUS_SAMPLES_READY,
    wire.STATUS_SAMPLES_READ,
    wire.STATUS_SAMPLES_FUSED,
    wire.STATUS_OVERRUNS,
)
_COUNTS = (
    wire.STATUS_BUS_FAULTS,
    wire.STATUS_BUS_RECOVERIES,
    wire.STATUS_COMMANDS_RECEIVED,
)


class Status:
    def __init__(self, mhz):
        self._mhz = mhz
        self._content = message(wire.STATUS)
        self._work_us = self._worst_us = self._samples = 0

    def worked(self, us):
        """Reports the time of a sample."""
        self._work_us += us
        self._samples += 1
        if us > self._worst_us:
            self._worst_us = us

    def supply(self, mv):
        """0: not known."""
        struct.pack_into("<H", self._content, wire.STATUS_SUPPLY, mv or 0xFFFF)

    def put(self, link, now, state, seen, counts, raw):
        """`seen` and `counts`: numbers for _SEEN and _COUNTS; `raw`: the last sample's
        message.
        """
        content = self._content
        mean_us = self._work_us // self._samples if self._samples else 0
        for place, value in zip(_SEEN, seen):  # noqa: B905 - has no strict there
            struct.pack_into("<I", content, place, value)
        for place, value in zip(_COUNTS, counts):  # noqa: B905
            struct.pack_into("<H", content, place, value & 0xFFFF)
        for place, value in (
            (wire.STATUS_MESSAGES_SENT, link.sent + 1),
            (wire.STATUS_MESSAGES_DROPPED, link.dropped),
            (wire.STATUS_CYCLES_MEAN, mean_us * self._mhz),
            (wire.STATUS_CYCLES_WORST, self._worst_us * self._mhz),
        ):
            struct.pack_into("<I", content, place, value)
        struct.pack_into("<H", content, wire.STATUS_COMMANDS_BAD, link.bad & 0xFFFF)
        content[wire.STATUS_STATE] = state
        for at in range(2):
            content[wire.STATUS_TEMPERATURE + at] = raw[wire.RAW_TEMPERATURE + at]
        link.put(content, len(wire.STATUS), now)
        self._work_us = self._worst_us = self._samples = 0
