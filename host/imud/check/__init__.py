# SPDX-License-Identifier: MIT
"""`imud check`: data from a probe go in; rows with a verdict come out.
No I/O. docs/check.md lists the rows.
"""
