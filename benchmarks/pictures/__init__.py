# SPDX-License-Identifier: MIT
"""Draws the plots of docs/pictures from what the other rooms measure."""
