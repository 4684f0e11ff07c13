# SPDX-License-Identifier: MIT
"""Records ten seconds of poses as CSV: record.py FILE [ENDPOINT]."""

import csv
import sys

from imud import subscribe

endpoint = sys.argv[2] if len(sys.argv) > 2 else "tcp/127.0.0.1:7447"
with (
    open(sys.argv[1], "w", newline="") as file,  # noqa: PTH123 - the usual way
    subscribe(endpoint=endpoint, seconds=10, history=100) as poses,
):
    table = csv.writer(file)
    table.writerow(["probe", "number", "t_ns", "w", "x", "y", "z"])
    for pose in poses:
        table.writerow([pose.probe, pose.number, pose.t_ns, *pose.q])
    print(f"{poses.missed.total} missed")
