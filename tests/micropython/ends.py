# SPDX-License-Identifier: MIT
"""Runs in MicroPython: run() until its button raises KeyboardInterrupt; prints what was
done to the keyboard's interrupt and to the pin's.
"""

import machine
from probe import loop

done = []


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

    def write(self, _data, _at, length):
        return length


def main():
    machine.unique_id = lambda: b"ends"
    machine.freq = lambda: 1_000_000
    machine.idle = lambda: None
    loop.Pin = Pin
    loop.kbd_intr = lambda code: done.append(code)
    try:
        words = {"button": Button(), "log": Log(), "watchdog": False, "plain": True}
        loop.run(Sensor(), Pin(), Wire(), **words)
    except KeyboardInterrupt:
        done.append("raised")
    print(done)


main()
