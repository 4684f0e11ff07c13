# SPDX-License-Identifier: MIT
"""Prints the poses of all probes for ten seconds: follow_pose.py [ENDPOINT]."""

import sys

from imud import subscribe

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
with subscribe(endpoint=endpoint, seconds=10) as poses:
    for pose in poses:
        yaw, pitch, roll = pose.yaw_pitch_roll_deg
        print(f"{pose.probe} yaw {yaw:.1f}, pitch {pitch:.1f}, roll {roll:.1f} degrees")
    print(f"missed: {poses.missed.total}")
