# SPDX-License-Identifier: MIT
"""Errors of strokes, by the C on this machine."""
