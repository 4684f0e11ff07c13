# SPDX-License-Identifier: MIT
"""The inner loops, as machine code where the port can make it."""

try:
    from .axes_viper import copy_axes, is_beyond, swap_axes
    from .frame_viper import crc16, decode, encode
except (ImportError, SyntaxError, ValueError):
    from .axes_plain import copy_axes, is_beyond, swap_axes
    from .frame_plain import crc16, decode, encode

__all__ = (
    "copy_axes",
    "crc16",
    "decode",
    "encode",
    "is_beyond",
    "swap_axes",
)
