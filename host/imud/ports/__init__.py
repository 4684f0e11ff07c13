# SPDX-License-Identifier: MIT
"""Serial ports: found, opened, and listened to at the baud rate of their probe."""
