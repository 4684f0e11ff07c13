# SPDX-License-Identifier: MIT
"""Calibration by the methods of papers, to compare with ours."""
