# SPDX-License-Identifier: MIT
"""Draws docs/pictures from what the other rooms measure."""
