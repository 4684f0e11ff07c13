# SPDX-License-Identifier: MIT
# What MicroPython's rp2 port freezes itself, but for modules of micropython-lib.
# ruff: noqa: F821  # names that MicroPython's makemanifest.py gives it
freeze("$(PORT_DIR)/modules")
