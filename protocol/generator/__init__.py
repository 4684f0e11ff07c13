# SPDX-License-Identifier: MIT
"""The parts of protocol/generate.py."""
