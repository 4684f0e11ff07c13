# SPDX-License-Identifier: MIT
"""The functions of axes_plain.py, compiled to machine code."""

import micropython


@micropython.viper
def copy_axes(source: ptr8, at: int, target: ptr8, place: int):
    n = 0
    while n < 6:
        target[place + n] = source[at + n]
        n += 1


@micropython.viper
def swap_axes(source: ptr8, at: int, target: ptr8, place: int):
    n = 0
    while n < 6:
        target[place + n] = source[at + n + 1]
        target[place + n + 1] = source[at + n]
        n += 2


@micropython.viper
def is_beyond(data: ptr8, place: int, limit: int) -> bool:
    n = 0
    while n < 6:
        value = data[place + n] | data[place + n + 1] << 8
        if limit < value and value < 65536 - limit:
            return True
        n += 2
    return False
