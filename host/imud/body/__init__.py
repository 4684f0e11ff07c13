# SPDX-License-Identifier: MIT
"""Several probes on one body: segments, their alignment, joint angles and the path of
a foot. Without I/O.

A segment's frame follows the ISB: x ahead, y from its end to its start (up when the
person stands), z to the right (Wu et al., J. Biomech. 35:543, 2002).
"""
