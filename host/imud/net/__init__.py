# SPDX-License-Identifier: MIT
"""Zenoh sessions, who may use them for what, and the keys that prove it."""
