# SPDX-License-Identifier: MIT
"""Times of foreign rows: counters that wrapped are continued; what can't be a time of
measurement is refused, with the row and the choice.
"""

from __future__ import annotations

import numpy as np

from imud.errors import FileError
from imud.rotation import FloatArray

# Counters of 32, 24, 16 bits, also when divided to ms or s; seconds of a week or a day.
MODULI = sorted(
    [2.0**bits * scale for bits in (16, 24, 32) for scale in (1.0, 1e-3, 1e-6)]
    + [period * scale for period in (86400.0, 604800.0) for scale in (1.0, 1e3)]
)
WRAP_STEPS = 20  # usual steps that may lie across a wrap
LATE_ROWS = 3  # behind an earlier row, before the clock counts as set back
SHARED_MAX = 0.05  # of rows with the time of the row before
PAUSE_MAX_S = 30 * 86400.0
UTC_S = (946_684_800.0, 4_102_444_800.0)  # 2000 to 2100; others count from a start


def straightened(
    name: str, values: FloatArray, unit_s: float, first_row: int = 1
) -> tuple[FloatArray, str]:
    """Times of rows in s from the first one, NaN as before, and what was done to them.
    `unit_s`: of the values; `first_row`: its number. FileError names the row.
    """
    places = np.flatnonzero(np.isfinite(values))
    t = values[places]
    steps = np.diff(t)
    if not (steps > 0.0).any():
        raise FileError(f"{name} does not increase: sort the rows, or pass --rate HZ")
    usual = float(np.median(steps[steps > 0.0]))
    note = ""
    is_back = steps < -LATE_ROWS * usual
    for modulus in MODULI if is_back.any() else ():
        across = steps[is_back] + modulus
        if across.min() > 0.0 and across.max() <= WRAP_STEPS * usual:
            t = t + modulus * np.concatenate([[0], np.cumsum(is_back)])
            note = f"wrapped {is_back.sum()} times at {modulus:.10g}"
            break
    _check(name, t, places + first_row, unit_s)
    found = np.full(len(values), np.nan)
    found[places] = (t - t[0]) * unit_s
    return found, note


def _check(name: str, t: FloatArray, rows: np.ndarray, unit_s: float) -> None:
    steps = np.diff(t)
    span_s = float(t.max() - t.min()) * unit_s
    # The rows of the last time are only begun.
    rate = f"{(t < t.max()).sum() / span_s:.4g}"
    if (steps < 0.0).mean() > 0.5:
        raise FileError(f"{name}: the newest row is first: sort the rows by time")
    if (steps == 0.0).mean() > SHARED_MAX:
        raise FileError(
            f"{name}: several rows share each time: pass --rate {rate} if they are "
            "evenly spaced, or --only COLUMN=VALUE if they are of several sensors"
        )
    behind = np.maximum.accumulate(t)[:-1] - t[1:]
    late = np.convolve(behind > 0.0, np.ones(LATE_ROWS + 1), "valid") > LATE_ROWS
    if late.any():
        at = int(np.argmax(late))
        raise FileError(
            f"row {rows[at + 1]}: {name} steps back by {behind[at] * unit_s:.6g} "
            "s: pass --rate HZ if the clock was set back, or split the file there if "
            "another recording begins"
        )
    at = int(np.argmax(steps))
    if steps[at] * unit_s > PAUSE_MAX_S:
        raise FileError(
            f"row {rows[at + 1]}: {name} jumps by {steps[at] * unit_s:.6g} s: "
            "correct the row, or split the file there"
        )
