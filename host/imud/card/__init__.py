# SPDX-License-Identifier: MIT
"""The SD card on which a probe logs: prepares, lists and reads it."""
