# SPDX-License-Identifier: MIT
"""Shared by the tests of the filter."""

from __future__ import annotations

import numpy as np

from core import desk
from core.desk import DEGREE, FIELD, FORCE, RATE, lib
from core.scenes import Filter, Scene
from imud import rotation

LEVEL = rotation.IDENTITY
UPSIDE_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def centred(rate_hz: int) -> Filter:
    """A filter for rates that are means over the sample period, as of a scene."""
    return Filter(rate_hz, 500_000 // rate_hz)


def twin(
    felt: Scene,
    calibrated_at: int = -1,
    bias_deg_s: object = (0, 0, 0),
    *,
    is_known: bool = True,
) -> desk.Array:
    """The double-precision filter over the very numbers that the fixed one gets."""
    return twin_stating(felt, calibrated_at, bias_deg_s, is_known=is_known)[0]


def twin_stating(
    felt: Scene,
    calibrated_at: int = -1,
    bias_deg_s: object = (0, 0, 0),
    *,
    is_known: bool = True,
    known_ut: object = (0.0, 0.0),
) -> tuple[desk.Array, desk.Array]:
    """The same, and what it states of tilt and heading, degrees. `known_ut`: the field
    of the calibration, to the north and up.
    """
    rows = felt.measurements()
    out = np.zeros((len(felt), 4))
    stated = np.zeros((len(felt), 2))
    settings = desk.ffi.new("struct fuse_twin_settings *")
    lib.fuse_twin_set_accuracy(settings, is_known)
    settings.known_ut = list(known_ut)
    desk.call(
        lib.fuse_twin_run,
        settings,
        len(felt),
        felt.rate_hz,
        0.0039,
        rows["gyr_rad_s_q25"] / RATE,
        rows["acc_m_s2_q21"] / FORCE,
        rows["mag_ut_q18"] / FIELD,
        felt.has_mag,
        felt.interval_us / 1e6,
        calibrated_at,
        np.array(bias_deg_s) * DEGREE,
        out,
        stated,
    )
    return out, stated


def rms(values: desk.Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
