# SPDX-License-Identifier: MIT
"""The card of a probe: prepared, found again, read."""
