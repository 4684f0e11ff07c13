# SPDX-License-Identifier: MIT
"""Images for imu-probes; manifest.json describes each of them."""

__version__ = "0"  # tools/release.py writes the version
