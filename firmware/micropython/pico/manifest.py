# SPDX-License-Identifier: MIT
# Modules frozen into MicroPython's rp2 port in addition to its own: the package, and a
# main.py, which a file of that name on the board would go before.
# ruff: noqa: F821  # names that MicroPython's makemanifest.py gives it
include("stock.py")
package("probe", base_path="..")
module("main.py")
