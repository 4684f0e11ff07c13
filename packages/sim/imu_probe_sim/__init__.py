# SPDX-License-Identifier: MIT
"""Virtual boards: programs that imud starts."""

__version__ = "0"  # tools/release.py writes the version
