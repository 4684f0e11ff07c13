# SPDX-License-Identifier: MIT
"""`imud bridge`: poses for programs of other fields, by a process of its own that is a
subscriber like any other. A module for each output: docs/bridge.md.
"""
