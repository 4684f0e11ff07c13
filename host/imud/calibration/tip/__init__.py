# SPDX-License-Identifier: MIT
"""Where the tip of a probe is."""
