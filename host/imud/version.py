# SPDX-License-Identifier: MIT
"""Which imud this is, as it was installed."""

from importlib import metadata


def version() -> str:
    return metadata.version("imud")
