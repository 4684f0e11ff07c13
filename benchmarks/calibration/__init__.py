# SPDX-License-Identifier: MIT
"""Errors that a calibration leaves."""
