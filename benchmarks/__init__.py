# SPDX-License-Identifier: MIT
"""Measures the filter, the firmware and the daemon: a room for each."""
