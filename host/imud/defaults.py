# SPDX-License-Identifier: MIT
"""Where a daemon is and what its keys begin with, unless told otherwise."""

PORT = 7447  # Zenoh's own
ENDPOINT = f"tcp/127.0.0.1:{PORT}"  # this machine alone
PREFIX = "imud"
