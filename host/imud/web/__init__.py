# SPDX-License-Identifier: MIT
"""The page: a server for browsers on this machine, and what it serves."""
