# SPDX-License-Identifier: MIT
"""Runs in MicroPython: frames contents by frame_plain.py and frame_viper.py.

    micropython frames.py FOLDER-OF-THE-PACKAGE CONTENTS FRAMES

Each content has its seed and its length before it, u16 both. Of each the frames of both
encoders are written, and what both decoders make of the frame, without a difference.
"""

import struct
import sys

import host

sys.path.append(sys.argv[1])

import frame_plain
import frame_viper


def framed(module, seed, content):
    room = bytearray(content + b"\0\0")
    out = bytearray(len(content) + 14)
    end = module.encode(seed, room, len(content), out, 10)
    assert end == len(out)
    return bytes(out[10:end])


def unframed(module, seed, frame):
    held = bytearray(frame)
    length = module.decode(held, len(frame) - 1)
    content = bytes(held[: length - 2])
    crc = held[length - 2] | held[length - 1] << 8
    assert module.crc16(seed, content, len(content)) == crc
    return content


def main(contents, frames):
    data = host.read(contents)
    made = []
    at = 0
    while at < len(data):
        seed, length = struct.unpack_from("<HH", data, at)
        content = data[at + 4 : at + 4 + length]
        at += 4 + length
        plain, viper = (framed(m, seed, content) for m in (frame_plain, frame_viper))
        assert plain == viper, content
        for module in (frame_plain, frame_viper):
            assert unframed(module, seed, plain) == content
        made.append(plain)
    host.write(frames, b"".join(made))


main(*sys.argv[2:])
