# SPDX-License-Identifier: MIT
"""A serial port at which nobody types."""


class Wire:
    """Takes all frames; brings nothing."""

    def __init__(self):
        self.frames = []

    def any(self):
        return 0

    def write(self, data, at, length):
        self.frames.append(bytes(data[at : at + length]))
        return length
