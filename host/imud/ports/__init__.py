# SPDX-License-Identifier: MIT
"""Serial ports: found, opened, and read at the baud rate of their probe."""
