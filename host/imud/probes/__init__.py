# SPDX-License-Identifier: MIT
"""What is known of a probe: its messages in order, its losses, its clock. No I/O."""
