# SPDX-License-Identifier: MIT
"""A virtual probe: the image that a user flashes, and the motion that it feels."""
