# SPDX-License-Identifier: MIT
"""What was recorded, worked on: decoded, exported, mended, played again."""
