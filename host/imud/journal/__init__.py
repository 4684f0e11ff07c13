# SPDX-License-Identifier: MIT
"""The daemon's journal on stderr: format, limits and phrases of its lines."""
