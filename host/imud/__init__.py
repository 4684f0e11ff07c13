# SPDX-License-Identifier: MIT
"""imud: the pose of an imu-probe as a network service."""
