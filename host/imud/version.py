# SPDX-License-Identifier: MIT
"""Which imud this is, as it was installed."""

from functools import cache
from importlib import metadata


@cache
def version() -> str:
    return metadata.version("imu-probe")
