# SPDX-License-Identifier: MIT
"""The network that `imud flash --wifi` has written to the board."""

import json
from time import ticks_diff, ticks_ms

from micropython import const

_AGAIN_MS = const(15000)  # between two tries to join; a slow router takes ten seconds


def of_file(path="wifi.json"):
    """The network of a file, which is being joined; None if there is no such file."""
    try:
        with open(path) as file:
            return Network(**json.load(file))
    except OSError:
        return None


class Network:
    """`wire`: the datagrams to the daemon at `host`."""

    def __init__(self, name, password, host, port):
        import network  # which a board without Wi-Fi has as little as sockets

        from .udp import UDP

        self._words = name, password
        self._station = network.WLAN(network.STA_IF)
        self._station.active(True)
        self._join()
        self.wire = UDP(host, port)

    def step(self):
        """Called once a second. Joins again: not every port does that by itself."""
        if self._station.isconnected():
            self._tried = ticks_ms()
        elif ticks_diff(ticks_ms(), self._tried) >= _AGAIN_MS:
            self._join()

    def _join(self):
        self._tried = ticks_ms()
        try:
            self._station.connect(*self._words)
        except OSError:  # it is still trying
            pass
