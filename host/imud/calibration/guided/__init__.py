# SPDX-License-Identifier: MIT
"""Calibration step by step: what to do with the probe, and what came of it."""
