# SPDX-License-Identifier: MIT
"""Content to frame and back, in plain bytecode; frame_viper.py has the same functions
for boards that compile to machine code. PROTOCOL.md explains the form.
"""


def crc16(seed, data, length):
    """The CRC of `length` bytes that follow those that gave `seed`."""
    crc = seed
    for at in range(length):
        # Eight bits at once: x^16 = x^12 + x^5 + 1, and the four bits that would leave
        # again by the x^12 are folded in first.
        top = (crc >> 8) ^ data[at]
        top ^= top >> 4
        crc = ((crc << 8) ^ (top << 12) ^ (top << 5) ^ top) & 0xFFFF
    return crc


def encode(seed, content, length, out, at):
    """Frames `length` bytes of content, behind which there is room for two more, into
    `out` from `at` on. Returns where the next frame begins.
    """
    crc = crc16(seed, content, length)
    content[length] = crc & 0xFF
    content[length + 1] = crc >> 8
    code = at
    at += 1
    for n in range(length + 2):
        byte = content[n]
        if byte:
            out[at] = byte
        else:
            out[code] = at - code
            code = at
        at += 1
    out[code] = at - code
    out[at] = 0
    return at + 1


def decode(frame, length):
    """Undoes COBS in place: `length` bytes without the delimiter become content and
    CRC. Returns their number; -1: the codes do not meet the end.
    """
    at = 0
    left = 0
    for n in range(length):
        byte = frame[n]
        if left:
            left -= 1
        else:
            left = byte - 1
            byte = 0
            if n == 0:
                continue
        frame[at] = byte
        at += 1
    return -1 if left else at
