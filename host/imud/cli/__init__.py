# SPDX-License-Identifier: MIT
"""The command line, and what it shows on a terminal."""

from imud.cli.entry import build_parser, main, program

__all__ = ["build_parser", "main", "program"]
