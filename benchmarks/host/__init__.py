# SPDX-License-Identifier: MIT
"""The daemon: speed, memory, clocks, faults of the wire, many probes and hosts."""
