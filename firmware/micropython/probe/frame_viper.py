# SPDX-License-Identifier: MIT
"""The functions of frame_plain.py, compiled to machine code."""

import micropython


@micropython.viper
def crc16(seed: int, data: ptr8, length: int) -> int:
    crc = seed
    at = 0
    while at < length:
        top = ((crc >> 8) ^ data[at]) & 0xFF
        top ^= top >> 4
        crc = ((crc << 8) ^ (top << 12) ^ (top << 5) ^ top) & 0xFFFF
        at += 1
    return crc


@micropython.viper
def encode(seed: int, content: ptr8, length: int, out: ptr8, at: int) -> int:
    crc = int(crc16(seed, content, length))
    content[length] = crc & 0xFF
    content[length + 1] = crc >> 8
    code = at
    at += 1
    n = 0
    length += 2
    while n < length:
        byte = content[n]
        if byte:
            out[at] = byte
        else:
            out[code] = at - code
            code = at
        at += 1
        n += 1
    out[code] = at - code
    out[at] = 0
    return at + 1


@micropython.viper
def decode(frame: ptr8, length: int) -> int:
    at = 0
    left = 0
    n = 0
    while n < length:
        byte = frame[n]
        n += 1
        if left:
            left -= 1
        else:
            left = byte - 1
            byte = 0
            if n == 1:
                continue
        frame[at] = byte
        at += 1
    return -1 if left else at
