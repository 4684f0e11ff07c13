# SPDX-License-Identifier: MIT
"""Stands for the module machine of a board on which nothing is wired."""

import os
from time import sleep_ms

PWRON_RESET = 1


class Implementation:
    """In place of sys.implementation: the board that a test names."""

    _machine = os.getenv("BOARD_MACHINE")
    version = (1, 25, 0)
    _mpy = int(os.getenv("BOARD_MPY") or 0)


class Pin:
    IN, OUT, OPEN_DRAIN, PULL_UP, PULL_DOWN, IRQ_RISING = range(6)

    def __init__(self, *_, **__):
        pass

    def value(self, *_):
        return int(os.getenv("BOARD_PINS") or 1)

    def irq(self, *_, **__):
        pass


class I2C:
    def __init__(self, *_, **__):
        pass

    def readfrom_mem(self, *_):
        raise OSError(5)

    writeto_mem = readfrom_mem_into = readfrom_mem


class WDT:
    def __init__(self, timeout):
        pass

    def feed(self):
        pass


def unique_id():
    return b"a board"


def freq():
    return 125_000_000


def reset_cause():
    return PWRON_RESET


def idle():
    sleep_ms(1)
