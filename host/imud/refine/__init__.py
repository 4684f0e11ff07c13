# SPDX-License-Identifier: MIT
"""The best estimate of a whole recording, afterwards: docs/decisions/refine.md."""
