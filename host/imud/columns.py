# SPDX-License-Identifier: MIT
"""The names of columns in tables: of what imud exports, and of the motions it reads."""

from __future__ import annotations

# What follows the axis in a name: acc_m_s2 becomes acc_x_m_s2.
UNITS = ("_m_s2", "_rad_s", "_uT", "_counts", "_m")


def parts_of(key: str, axes: str = "xyz") -> tuple[str, ...]:
    """The columns of a vector or a quaternion, by the key of its JSON."""
    unit = next((unit for unit in UNITS if key.endswith(unit)), "")
    name = key.removesuffix(unit)
    return tuple(f"{name}_{axis}{unit}" for axis in axes)
