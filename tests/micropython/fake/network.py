# SPDX-License-Identifier: MIT
"""The Wi-Fi of a board: what a test has put into air.json beside its files."""

import json

STA_IF = 0
STAT_CONNECTING, STAT_WRONG_PASSWORD, STAT_NO_AP_FOUND, STAT_GOT_IP = 1, -3, -2, 3


class WLAN:
    _status = 0

    def __init__(self, _interface):
        with open("air.json") as file:
            self._air = json.load(file)

    def active(self, _is_on):
        pass

    def config(self, **_):
        raise ValueError("unknown config param")  # as on a Pico W

    def disconnect(self):
        WLAN._status = 0

    def connect(self, name, password):
        WLAN._status = STAT_GOT_IP
        if name not in self._air["seen"]:
            WLAN._status = STAT_NO_AP_FOUND
        elif self._air["password"] is None:
            WLAN._status = STAT_CONNECTING
        elif password != self._air["password"]:
            WLAN._status = STAT_WRONG_PASSWORD

    def isconnected(self):
        return WLAN._status == STAT_GOT_IP

    def status(self):
        return WLAN._status

    def scan(self):
        return [(name.encode(),) for name in self._air["seen"]] + [(b"caf\xe9",)]

    def ifconfig(self):
        return self._air["address"], "255.0.0.0", "", ""
