# SPDX-License-Identifier: MIT
"""Values that the tests of ROS 2 share."""

from __future__ import annotations

from rosbags.typesys import Stores, get_typestore

JAZZY = get_typestore(Stores.ROS2_JAZZY)

T_NS = 1_795_237_912_345_678_901
Q = (0.9, 0.1, -0.2, 0.3)

RATE, FORCE, FIELD = (0.01, -0.02, 3.0), (-9.5, 0.125, 9.75), (2e-5, -1e-6, 4.5e-5)
