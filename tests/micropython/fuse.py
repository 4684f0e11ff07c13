# SPDX-License-Identifier: MIT
"""Runs in MicroPython: raw messages through Madgwick's filter of the package.

    micropython fuse.py HELLO RAWS POSES HZ

The files hold contents of messages: a hello, raw messages one after the other, and of
each step of the filter the pose. The filter makes this many steps per second.
"""

import struct
import sys

from probe import wire
from probe.link import message
from probe.madgwick import Madgwick
from probe.plain_fusion import Fusion


def main(hello_path, raws_path, poses_path, hz):
    with open(hello_path, "rb") as file:
        hello = file.read()
    (rate_hz,) = struct.unpack_from("<H", hello, wire.HELLO_SAMPLE_RATE)
    chosen = Madgwick()
    chosen.RATE_HZ = int(hz)
    fusion = Fusion(chosen)
    fusion.begin(rate_hz, hello)
    pose = message(wire.POSE)
    with open(raws_path, "rb") as raws, open(poses_path, "wb") as poses:
        while True:
            raw = raws.read(len(wire.RAW))
            if not raw:
                break
            (time_us,) = struct.unpack_from("<I", raw, 5)
            if fusion.take(raw, time_us & 0x3FFFFFFF):
                fusion.fill(pose)
                pose[1:9] = raw[1:9]
                poses.write(memoryview(pose)[: len(wire.POSE)])


main(*sys.argv[1:])
