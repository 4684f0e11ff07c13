# SPDX-License-Identifier: MIT
"""The format of logs: MCAP files written and read."""
