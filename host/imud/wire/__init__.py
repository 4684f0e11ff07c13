# SPDX-License-Identifier: MIT
"""Converts bytes to messages and back: frames, and their content by the schema."""
