# SPDX-License-Identifier: MIT
"""Errors of the tip, by wobbles and by positions."""
