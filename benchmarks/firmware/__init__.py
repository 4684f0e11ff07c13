# SPDX-License-Identifier: MIT
"""The images: cycles, flash, RAM, order of functions, card, MicroPython."""
