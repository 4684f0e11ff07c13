# SPDX-License-Identifier: MIT
"""ROS 2 over Zenoh, compatible with rmw_zenoh: topics, and messages as bytes."""
