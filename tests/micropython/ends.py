# SPDX-License-Identifier: MIT
"""Runs in MicroPython: run() until its button raises KeyboardInterrupt; prints what was
done to the keyboard's interrupt and to the pin's, and what was sent.
"""

import sys

import machine

done = []
sent = []


class MicroPython:
    @staticmethod
    def const(value):
        return value

    @staticmethod
    def kbd_intr(code):
        done.append(code)


def unique_id():
    done.append("facts")
    return b"ends"


sys.modules["micropython"] = MicroPython
machine.unique_id = unique_id
from probe import loop  # noqa: E402 - whose first statement is one of those


class Pin:
    IRQ_RISING = 1

    def irq(self, handler, *_, **__):
        done.append("pin on" if handler else "pin off")

    def value(self):
        return 0


class Button:
    turns = 0

    def value(self):
        self.turns += 1
        if self.turns == 3:
            done.append("interrupted")
            raise KeyboardInterrupt
        return 1


class Sensor:
    def attach_plain(self, probe, ready):
        pass


class Log:
    def open(self, _probe):
        done.append("log open")

    def write(self, data, at, length):
        pass

    def step(self, _probe):
        pass

    def close(self):
        done.append("log closed")


class Wire:
    def any(self):
        return 0

    def write(self, data, at, length):
        sent.append(bytes(data[at : at + length]))
        return length


def main():
    machine.freq = lambda: (1_000_000, 500_000)  # as on a pyboard
    machine.idle = lambda: None
    loop.Pin = Pin
    try:
        words = {"button": Button(), "log": Log(), "watchdog": False}
        loop.run(Sensor(), Pin(), Wire(), **words)
    except KeyboardInterrupt:
        done.append("raised")
    print(done)
    print("".join(f"{byte:02x}" for byte in b"".join(sent)))


main()
