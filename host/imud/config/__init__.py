# SPDX-License-Identifier: MIT
"""Settings of the daemon, and the TOML files that hold them."""
