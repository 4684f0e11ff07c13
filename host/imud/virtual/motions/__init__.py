# SPDX-License-Identifier: MIT
"""Seeded motions with exact truth, for benchmarks: docs/motions.md lists the groups."""
