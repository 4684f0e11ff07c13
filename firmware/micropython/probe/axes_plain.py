# SPDX-License-Identifier: MIT
"""Three numbers of 16 bits in bytes, in plain bytecode."""


def copy_axes(source, at, target, place):
    """Three little-endian numbers."""
    for n in range(6):
        target[place + n] = source[at + n]


def swap_axes(source, at, target, place):
    """Three big-endian numbers, to little-endian ones."""
    for n in range(0, 6, 2):
        target[place + n] = source[at + n + 1]
        target[place + n + 1] = source[at + n]


def is_beyond(data, place, limit):
    """Whether one of three little-endian numbers is beyond +-limit."""
    for n in range(0, 6, 2):
        value = data[place + n] | data[place + n + 1] << 8
        if limit < value < 65536 - limit:
            return True
    return False
