# SPDX-License-Identifier: MIT
"""Tables: the names of columns, of what imud exports and of the motions it reads; and
texts in their cells.
"""

from __future__ import annotations

# Suffixes after the axis in a name: acc_m_s2 becomes acc_x_m_s2.
UNITS = ("_m_s2", "_rad_s", "_uT", "_counts", "_m")


def parts_of(key: str, axes: str = "xyz") -> tuple[str, ...]:
    """The columns of a vector or a quaternion, by the key of its JSON."""
    unit = next((unit for unit in UNITS if key.endswith(unit)), "")
    name = key.removesuffix(unit)
    return tuple(f"{name}_{axis}{unit}" for axis in axes)


# A cell that begins so is a formula to a spreadsheet, which runs it.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def inert(text: str) -> str:
    """The text of a cell, which may be a stranger's: no formula, no control character.
    A spreadsheet shows what follows an apostrophe as it is.
    """
    mark = "'" if text.startswith(_FORMULA) else ""
    return mark + "".join(c if c.isprintable() else "?" for c in text)
