# SPDX-License-Identifier: MIT
"""What the daemon is told to do: settings, and TOML files that say them."""
