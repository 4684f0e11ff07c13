# SPDX-License-Identifier: MIT
"""imud: the pose of an imu-probe as a network service."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from imud.client import subscribe

__all__ = ["subscribe"]


def __getattr__(name: str) -> Any:
    """Zenoh is loaded by who subscribes, not by who imports a module of ours."""
    if name == "subscribe":
        from imud.client import subscribe

        return subscribe
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
