# SPDX-License-Identifier: MIT
"""Log files: writes and reads MCAP."""
