# SPDX-License-Identifier: MIT
"""The outputs: Zenoh, ROS 2 and the log. Each is a `Sink` of daemon/lane.py: it takes
records and presences in a thread of its own. A sink knows its library, the records, and
what it needs of the rooms below (settings, network, log format); no port, no session,
no other sink.
"""
