# SPDX-License-Identifier: MIT
"""The state of a probe: its messages in order, its losses, its clock. No I/O."""
