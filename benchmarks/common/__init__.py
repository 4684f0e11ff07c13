# SPDX-License-Identifier: MIT
"""Shared by several rooms: boards, samples, filters, errors, captures."""
