# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the plain probe at a daemon's UDP port, with samples of its own.

    micropython udp_probe.py KEY HOST PORT NAME plain|module

It ends when its standard input does.
"""

import select
import sys
from time import sleep_ms, ticks_add, ticks_diff, ticks_us

import machine
from probe import udp, wire
from probe.plain import Probe

RATE_HZ = 100


class Driver:
    """A sensor that is there at once."""

    WRONG_CHIP = 1000
    rate_hz = RATE_HZ
    who_am_i = 0

    def begin(self, i2c=None):
        pass

    def set_up(self, _now):
        return True

    def describe(self, hello):
        hello[wire.HELLO_SENSOR] = wire.SENSOR_LSM9DS0
        hello[wire.HELLO_SAMPLE_RATE] = RATE_HZ

    def read(self, _raw):
        return True


class Ready:
    def value(self):
        return False


class AsModule:
    """The plain probe with the calls of the module: bytes in, bytes out."""

    def __init__(self, probe):
        self.probe = probe
        self.acquire, self.edge, self.step = probe.acquire, probe.edge, probe.step
        self.heard, self.sent = b"", b""

    def any(self):
        return len(self.heard)

    def readinto(self, one):
        one[0], self.heard = self.heard[0], self.heard[1:]

    def write(self, data, at, length):
        self.sent += bytes(data[at : at + length])
        return length

    def receive(self, data):
        self.heard += data
        self.probe.receive(self)

    def take(self, buffer):
        self.probe.send(self)
        length = min(len(buffer), len(self.sent))
        buffer[:length] = self.sent[:length]
        self.sent = self.sent[length:]
        return length


def main(key, host, port, name, kind):
    machine.unique_id = name.encode
    udp.EVERYBODY = "127.255.255.255"
    link = udp.UDP(host, int(port), key)
    probe = Probe(None, id=machine.unique_id(), firmware="udp")
    probe.attach(Driver(), None, Ready())
    if kind == "module":
        probe = AsModule(probe)
    receive, send = link.receiver(probe), link.sender(probe)
    ended = select.poll()
    ended.register(sys.stdin, select.POLLIN)
    due = ticks_us()
    while not ended.poll(0):
        now = ticks_us()
        if ticks_diff(now, due) >= 0:
            due = ticks_add(due, 1_000_000 // RATE_HZ)
            probe.edge(None)
        probe.acquire()
        receive(link)
        probe.step(False)
        send(link)
        sleep_ms(1)


main(*sys.argv[1:])
