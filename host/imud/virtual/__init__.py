# SPDX-License-Identifier: MIT
"""Virtual probes: the real firmware image in an emulator, and simulated motion."""
