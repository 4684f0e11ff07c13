# SPDX-License-Identifier: MIT
"""Zenoh sessions, and the users, keys and rules that guard them."""
