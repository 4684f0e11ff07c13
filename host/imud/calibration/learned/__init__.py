# SPDX-License-Identifier: MIT
"""Calibration from free motion, while a probe is in use."""
