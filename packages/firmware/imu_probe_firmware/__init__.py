# SPDX-License-Identifier: MIT
"""Images for imu-probes; manifest.json says what each of them is."""

__version__ = "0"  # tools/release.py writes the version
