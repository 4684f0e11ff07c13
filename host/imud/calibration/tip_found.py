# SPDX-License-Identifier: MIT
"""The tip as a calibration finds it, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass

from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class TipFound:
    """Body frame. None: this method does not find it."""

    method: str  # as the params name it
    offset_m: FloatArray | None = None  # of the tip from the sensor
    sigma_m: float | None = None  # one-sigma error of an axis of it
    axis: FloatArray | None = None  # unit vector out of the surface it stands on
    axis_sigma_deg: float | None = None  # one-sigma error of its direction, each way
    seconds: float = 0.0
    note: str | None = None
