# SPDX-License-Identifier: MIT
"""Calibration: readings go in; what turns them into true vectors, and how good that is,
come out. No I/O. docs/calibration.md explains the method.
"""
