# SPDX-License-Identifier: MIT
"""Runs the programs of this room, whether or not the one before misses a figure."""

from __future__ import annotations

import sys

from benchmarks.honesty import desk, grounds, since_origin

PROGRAMS = (desk.main, grounds.main, since_origin.main)


def main() -> int:
    """Pass the options that all have, --board, --quick and --jobs, to each; 1 if one
    misses a required figure.
    """
    return max(program(sys.argv[1:]) for program in PROGRAMS)


if __name__ == "__main__":
    sys.exit(main())
