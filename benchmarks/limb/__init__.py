# SPDX-License-Identifier: MIT
"""Joint angles of legs and of chains of segments."""
