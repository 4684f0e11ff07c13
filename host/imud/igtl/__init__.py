# SPDX-License-Identifier: MIT
"""OpenIGTLink, which 3D Slicer and PLUS read: names, messages as bytes, a server."""
