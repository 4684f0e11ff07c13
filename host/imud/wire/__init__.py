# SPDX-License-Identifier: MIT
"""Bytes to messages and back: frames, and what the schema says of their content."""
