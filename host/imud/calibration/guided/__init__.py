# SPDX-License-Identifier: MIT
"""Calibration step by step: instructions for the user, and the result."""
