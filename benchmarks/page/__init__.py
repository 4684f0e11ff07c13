# SPDX-License-Identifier: MIT
"""The page of a daemon in a browser."""
