# SPDX-License-Identifier: MIT
"""The covariance of an orientation with an origin."""

from __future__ import annotations

from typing import Any

import numpy as np

from imud.probes.references import SinceErrors
from imud.ros2 import cdr
from imud.ros2.covariance import FREE_RAD2, orientation_covariance


def covariance(since: SinceErrors | None, **fields: Any) -> Any:
    pose = {
        "tilt_sigma_deg": 0.5,
        "heading_sigma_deg": 2.0,
        "flags": ("tared",),
        "since_origin": since,
    }
    return np.reshape(orientation_covariance(pose | fields), (3, 3))


def test_with_an_origin_it_is_the_error_since_then() -> None:
    found = covariance(SinceErrors(0.12, 0.05, 60.0))
    assert np.allclose(found, np.diag(np.radians([0.05, 0.05, 0.12]) ** 2))
    assert covariance(SinceErrors(None, 0.05, 60.0))[2, 2] == FREE_RAD2
    unknown = orientation_covariance(
        {
            "tilt_sigma_deg": None,
            "heading_sigma_deg": None,
            "flags": ("tared",),
            "since_origin": SinceErrors(None, None, 60.0),
        }
    )
    assert unknown is cdr.ABSENT


def test_while_that_is_not_known_both_ends_count() -> None:
    both = 2.0 * np.diag(np.radians([0.5, 0.5, 2.0]) ** 2)
    for since in (SinceErrors(None, None, 60.0, "gap"), None):
        assert np.allclose(covariance(since), both)
    assert covariance(None, heading_sigma_deg=100.0)[2, 2] == FREE_RAD2
