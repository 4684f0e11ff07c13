# SPDX-License-Identifier: MIT
"""Signs of quaternions, which mean the same attitude with either: poses of one boot of
a probe get them so that the four numbers never jump.
"""

from __future__ import annotations

from imud import rotation
from imud.rotation import Quat


class Signs:
    """Signs of the quaternions of one probe's poses, in order."""

    def __init__(self) -> None:
        self._t_device_us: float | None = None
        self._last: Quat | None = None

    def steady(self, q: Quat, t_device_us: float | None) -> Quat:
        """`q` on the side of the last one. Device time that goes back starts a new
        series: the probe has restarted.
        """
        last_us, self._t_device_us = self._t_device_us, t_device_us
        if t_device_us is None or last_us is None or t_device_us < last_us:
            self._last = None
        self._last = rotation.beside(q, self._last)
        return self._last
