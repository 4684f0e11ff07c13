# SPDX-License-Identifier: MIT
"""ROS 2 as rmw_zenoh has it on Zenoh: topics, and messages as bytes."""
