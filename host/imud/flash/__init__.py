# SPDX-License-Identifier: MIT
"""Writes firmware into boards, by the bootloader that each of them has."""
