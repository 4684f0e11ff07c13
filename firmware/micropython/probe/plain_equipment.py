# SPDX-License-Identifier: MIT
"""The message `equipment` of a probe without the C module: its battery, if any."""

import struct

from . import wire
from .link import message


class Equipment:
    def __init__(self):
        self._content = None

    def battery(self, mv, is_low):
        """`mv`: 65535 where it is not known."""
        if self._content is None:
            self._content = message(wire.EQUIPMENT)
        struct.pack_into("<H", self._content, wire.EQUIPMENT_BATTERY, mv)
        self._content[wire.EQUIPMENT_POWER] = wire.POWER_LOW if is_low else 0

    def put(self, link, now):
        if self._content is not None:
            link.put(self._content, len(wire.EQUIPMENT), now)
