# SPDX-License-Identifier: MIT
"""The firmware's C on this machine, as every benchmark loads it."""

from imud._core import Replay

__all__ = ["Replay"]
