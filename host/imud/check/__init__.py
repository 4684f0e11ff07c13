# SPDX-License-Identifier: MIT
"""`imud check`: what was received from a probe goes in; rows with a verdict come out.
No I/O. docs/check.md lists the rows.
"""
