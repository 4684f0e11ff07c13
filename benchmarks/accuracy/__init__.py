# SPDX-License-Identifier: MIT
"""Errors of orientation, of our filter and of others."""
