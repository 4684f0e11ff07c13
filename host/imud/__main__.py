# SPDX-License-Identifier: MIT
"""`python -m imud` is `imud`."""

import sys

from imud.cli import main

if __name__ == "__main__":
    sys.exit(main())
