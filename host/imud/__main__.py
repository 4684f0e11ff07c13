# SPDX-License-Identifier: MIT
"""`python -m imud` is `imud`."""

from imud.cli import program

if __name__ == "__main__":
    program()
