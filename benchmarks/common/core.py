# SPDX-License-Identifier: MIT
"""The firmware's C on this machine, as every benchmark loads it."""

from imud import checkout

checkout.refresh_core()

from imud._core import Replay  # noqa: E402 - built again where it was out of date

__all__ = ["Replay"]
