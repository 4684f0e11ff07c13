# SPDX-License-Identifier: MIT
"""Which columns of a foreign table are which sensor, in which unit, along which axes:
as it was told, else guessed by names and by what the numbers can be.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from imud.errors import FileError
from imud.gravity import GRAVITY_M_S2
from imud.recordings.foreign_table import words
from imud.recordings.foreign_text import ForeignTable
from imud.recordings.foreign_times import SHARED_MAX, UTC_S, straightened
from imud.rotation import FloatArray

SENSORS = ("acc", "gyr", "mag")
# Words of columns' names, the likelier ones first.
NAMES = {
    "acc": ("acc", "accel", "acceleration", "accelerometer", "linear", "a", "f"),
    "gyr": ("gyr", "gyro", "gyroscope", "angular", "rate", "omega", "w", "g"),
    "mag": ("mag", "magnetometer", "magnetic", "m", "b", "h"),
}
TIMES = ("time", "timestamp", "datetime", "stamp", "t", "seconds", "secs", "micros",
         "millis", "zeit", "uhrzeit", "temps", "tiempo", "tempo")  # fmt: skip

# Of a lone number: rows in a second.
RATES = {
    *("fs", "hz", "odr", "rate", "freq", "frequency"),
    *("sampling", "samplerate", "samplingrate"),
}
RATE_HZ = (1.0, 10_000.0)

PROCESSED = ("linear", "user", "gravity")
# A time in two columns.
SECONDS, NANOSECONDS = ("s", "sec", "secs"), ("nanosec", "nsec", "nsecs")

DEGREE = math.pi / 180.0
# The value of each unit in m/s2, rad/s, uT and s.
UNITS: dict[str, dict[str, float]] = {
    "acc": {"m/s2": 1.0, "g": GRAVITY_M_S2, "mg": GRAVITY_M_S2 / 1000.0, "cm/s2": 0.01},
    "gyr": {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "mdeg/s": DEGREE / 1e3},
    "mag": {"uT": 1.0, "T": 1e6, "mT": 1e3, "nT": 1e-3, "G": 100.0, "mG": 0.1},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "days": 86400.0},
}
# Counts of common ranges: 2, 4, 8, 16 g and 250, 500, 1000, 2000 deg/s in 16 bits.
COUNTS = {
    "acc": {f"1/{n} g": GRAVITY_M_S2 / n for n in (16384, 8192, 4096, 2048)},
    "gyr": {f"1/{n:g} deg/s": DEGREE / n for n in (131, 65.5, 32.8, 16.4)},
}
SPELT = {
    "m/s^2": "m/s2", "ms2": "m/s2", "ms^-2": "m/s2", "mps2": "m/s2",
    "dps": "deg/s", "deg/sec": "deg/s", "degps": "deg/s", "rad": "rad/s",
    "rads": "rad/s", "radps": "rad/s", "deg": "deg/s", "gauss": "G", "ut": "uT",
    "°/s": "deg/s", "μt": "uT", "μs": "us",
    "nt": "nT", "mgauss": "mG", "sec": "s", "usec": "us", "msec": "ms",
    "micros": "us", "millis": "ms", "nsec": "ns",
}  # fmt: skip

# A step of the time between these is a rate that IMUs have.
STEP_S = (1.0 / 5000.0, 0.2)
TAIL = 100  # times of a table that those of the next one continue
EARTH_UT = (18.0, 75.0)
GRAVITY_NEAR = 0.25  # by which the median force may be off gravity, as a share
NAMED_NEAR = 0.5  # the same where its unit is named
TURNING_NEAR = 2.0  # by which the rotation of gravity may be off the gyroscope
SMOOTH_S = 0.3  # over which force is averaged to see gravity turn


@dataclass(slots=True)
class ForeignMap:
    """The mapping as given, then completed by guesses. `units`: of acc, gyr, mag, time,
    by what one of them is in SI units and uT. `axes`: as "x,-z,y", where they point in
    the body. `only`: what columns hold in the rows that are read.
    """

    columns: dict[str, tuple[str, ...]] = field(default_factory=dict)
    units: dict[str, float] = field(default_factory=dict)
    axes: dict[str, str] = field(default_factory=dict)
    rate_hz: float | None = None
    only: dict[str, str] = field(default_factory=dict)
    topics: tuple[str, ...] = ()  # of a bag that are read; empty: any
    named: dict[str, str] = field(default_factory=dict)  # units, in words
    note: str = ""  # on the times
    began_s: float | None = None  # UTC of the first time, if it is one
    rows: int = 0  # of the tables so far
    tail: tuple[FloatArray, FloatArray] | None = None  # their last times, as read, in s
    guessed: set[str] = field(default_factory=set)

    def lines(self) -> Iterator[str]:
        """For people."""
        note = f", {self.note}" if self.note else ""
        for name in ("time", *SENSORS):
            if name not in self.columns:
                continue
            how = " (guessed)" if name in self.guessed else ""
            unit = self.named.get(name, "")
            along = f", axes {self.axes[name]}" if name in self.axes else ""
            noted = note if name == "time" else ""
            columns = ", ".join(self.columns[name])
            yield f"{name:<5}{columns}: {unit}{how}{along}{noted}"
        if "time" not in self.columns:
            yield f"time {self.rate_hz:g} rows per second{note}"


def unit_of(sensor: str, text: str) -> float:
    """What one of a unit is: g, or 0.061mg. FileError if there is no such unit."""
    known = UNITS[sensor]
    digits = text.strip()
    for at in range(len(digits), -1, -1):
        try:
            factor = float(digits[:at] or 1.0)
        except ValueError:
            continue
        name = digits[at:].strip()
        name = name if name in known else SPELT.get(name.lower(), name)
        if name in known:
            return factor * known[name]
        break
    raise FileError(f"{sensor}: no unit {text!r}; there are {', '.join(known)}")


def vector(table: ForeignTable, told: ForeignMap, sensor: str) -> FloatArray:
    """The readings of a sensor in the body frame, in SI units and uT, shape (n, 3)."""
    return told.units[sensor] * _readings(table, told, sensor)


def _readings(table: ForeignTable, told: ForeignMap, sensor: str) -> FloatArray:
    """The same in the table's unit."""
    rows = np.stack([table.columns[name] for name in told.columns[sensor]], axis=1)
    axes = told.axes.get(sensor, "x,y,z")
    parts = [part.strip() for part in axes.split(",")]
    names = [part.lstrip("+-") for part in parts]
    if sorted(names) != ["x", "y", "z"]:
        raise FileError(
            f"{sensor}: axes are three like x,-z,y, one for each column, not {axes!r}"
        )
    found = np.empty_like(rows)
    for at, part in enumerate(parts):
        found[:, "xyz".index(part[-1])] = (
            -rows[:, at] if part[0] == "-" else rows[:, at]
        )
    return found


def completed(table: ForeignTable, told: ForeignMap) -> FloatArray:
    """Guesses all that the map was not told, by the first of several tables, and
    returns when each row was, s, shape (n,). FileError if that is not possible, or if
    gravity contradicts: it names the missing option.
    """
    if told.rows:
        return _times_s(table, told)
    given = set(told.units)
    for name, columns in told.columns.items():
        if missing := [each for each in columns if each not in table.columns]:
            raise FileError(
                f"{name}: no column {', '.join(missing)}; there are "
                f"{', '.join(table.columns)}"
            )
    _find_columns(table, told)
    if table.is_known:
        told.units = {"acc": 1.0, "gyr": 1.0, "mag": 1e6, "time": 1.0} | told.units
        named = {"acc": "m/s2", "gyr": "rad/s", "mag": "T", "time": "s"}
        told.named = named | told.named
    _find_time(table, told)
    t_s = _times_s(table, told)
    _find_acc(table, told)
    if "acc" not in given:
        _check_gravity(table, told)
    _find_mag(table, told)
    _find_gyr(table, told, t_s)
    if "gyr" not in given:
        _check_turning(table, told, t_s)
    return t_s


def _check_gravity(table: ForeignTable, told: ForeignMap) -> None:
    size = float(np.nanmedian(np.linalg.norm(vector(table, told, "acc"), axis=1)))
    if abs(size / GRAVITY_M_S2 - 1.0) > NAMED_NEAR:
        raise FileError(
            f"{', '.join(told.columns['acc'])}: {size:.3g} m/s2 as a rule, where "
            "gravity is 9.8: choose columns with gravity by --map acc=X,Y,Z, or pass "
            "the right unit, such as --unit acc=g"
        )


def _check_turning(table: ForeignTable, told: ForeignMap, t_s: FloatArray) -> None:
    factor = seen_turning(vector(table, told, "acc"), vector(table, told, "gyr"), t_s)
    if factor is not None and not 1.0 / TURNING_NEAR < factor < TURNING_NEAR:
        rate_hz = 1.0 / (factor * float(np.nanmedian(np.diff(t_s))))
        raise FileError(
            f"gravity rotates {factor:.2g} times as fast as the gyroscope says: pass "
            f"--rate HZ (about {rate_hz:.0f}) if times are wrong, or --unit gyr=UNIT"
        )


def _find_columns(table: ForeignTable, told: ForeignMap) -> None:
    for sensor in SENSORS:
        if sensor not in told.columns:
            found = _triple(table.columns, NAMES[sensor])
            if sensor == "mag" and found is not None:
                # There was none: it is empty, or zeros.
                filled = [np.nan_to_num(table.columns[name]).any() for name in found]
                found = found if any(filled) else None
            if found is not None:
                told.columns[sensor] = found
                told.guessed.add(sensor)
    for sensor in ("acc", "gyr"):
        if sensor not in told.columns:
            raise FileError(
                f"no columns found for {sensor}; choose from "
                f"{', '.join(table.columns)} with --map {sensor}=X,Y,Z"
            )


def _triple(
    columns: Mapping[str, FloatArray], names: tuple[str, ...]
) -> tuple[str, ...] | None:
    """Three columns that a name and x, y, z tell."""
    for name in names:
        found = []
        for axis in "xyz":
            fits = [each for each in columns if _is_named(words(each), name, axis)]
            # The force that a sensor measures has gravity in it, and is not gravity.
            plain = [each for each in fits if not set(words(each)) & set(PROCESSED)]
            if len(plain) > 1:
                raise FileError(
                    f"several columns fit {names[0]}: {', '.join(plain)}; choose three "
                    f"with --map {names[0]}=X,Y,Z"
                )
            found += (plain or fits)[:1]
        if len(found) == 3:
            return tuple(found)
    return None


def _is_named(parts: list[str], name: str, axis: str) -> bool:
    joined = (name + axis, axis + name, f"{name}-{axis}", f"{name}{axis}")
    # A letter alone may be a unit's: acc_x_m_s2.
    places = parts if len(name) > 2 else parts[:1]
    return any(part in joined for part in parts) or (name in places and axis in parts)


def _find_time(table: ForeignTable, told: ForeignMap) -> None:
    if told.rate_hz is None:
        _find_clock(table, told)
    else:  # a clock tells when it began at most
        with contextlib.suppress(FileError):
            _find_clock(table, told)


def _find_clock(table: ForeignTable, told: ForeignMap) -> None:
    if "time" not in told.columns:
        found = [n for n in table.columns if set(words(n)) & set(TIMES)]
        if not found and told.rate_hz is None:
            told.rate_hz = _rate_hz(table, told)
            if told.rate_hz is not None:
                return
        if not found:
            raise FileError(
                "no column of time found: --map time=COLUMN, or --rate HZ for evenly "
                "spaced rows"
            )
        parts = [n for n in found if set(words(n)) & set(NANOSECONDS)]
        is_split = bool(parts) and bool(set(words(found[0])) & set(SECONDS))
        told.columns["time"] = (found[0], *(parts[:1] if is_split else ()))
        told.guessed.add("time")
    if "time" in told.units:
        return
    name = told.columns["time"][0]
    if name in table.in_seconds:
        told.units["time"], told.named["time"] = 1.0, "s"
        return
    if _named_unit("time", name, told):
        return
    steps = np.abs(np.diff(table.columns[name]))
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if (steps == 0.0).mean() > SHARED_MAX:
        step = float(np.nanmean(steps))  # of rows, not of packets
    if (steps == 1.0).all():
        raise FileError(f"{name} counts rows, or ms: pass --rate HZ, or --unit time=ms")
    for unit, factor in UNITS["time"].items():
        if STEP_S[0] <= step * factor <= STEP_S[1]:
            _guess(told, "time", unit, factor)
            return
    raise FileError(
        f"unknown unit of {name}, with steps of {step:g}: pass one such as --unit "
        "time=ms"
    )


def _rate_hz(table: ForeignTable, told: ForeignMap) -> float | None:
    """That columns of one number tell by their name, best those of the force's struct.
    FileError if they differ.
    """
    found = {}
    for name, column in table.columns.items():
        is_named = not RATES.isdisjoint(words(name))
        is_rate = is_named and RATE_HZ[0] <= column[0] <= RATE_HZ[1]
        if is_rate and (column == column[0]).all():
            found[name] = float(column[0])
    place = told.columns["acc"][0].rpartition(".")[0]
    near = [hz for name, hz in found.items() if name.rpartition(".")[0] == place]
    rates = {*(near or found.values())}
    if len(rates) > 1:
        raise FileError(f"several rates: {', '.join(found)}: pass one with --rate HZ")
    return rates.pop() if rates else None


def _named_unit(sensor: str, column: str, told: ForeignMap) -> bool:
    """Whether a column's name tells its unit, which is then known."""
    parts = words(column)
    pairs = map("/".join, itertools.pairwise(parts))
    for part in (*parts[1:], *pairs) if len(parts) > 1 else parts:
        name = part if part in UNITS[sensor] else SPELT.get(part, part)
        name = {"ut": "uT", "t": ""}.get(name, name)
        if name in UNITS[sensor]:
            told.units[sensor] = UNITS[sensor][name]
            told.named[sensor] = name
            return True
    return False


def _guess(told: ForeignMap, sensor: str, unit: str, factor: float) -> None:
    told.units[sensor], told.named[sensor] = factor, unit
    told.guessed.add(sensor)


def _which_unit(
    told: ForeignMap, sensor: str, size: float, examples: tuple[str, str]
) -> FileError:
    """The error that no unit fits; `examples`: a unit, and the size of a count."""
    unit, count = examples
    return FileError(
        f"unknown unit of {', '.join(told.columns[sensor])}, of typical length "
        f"{size:g}: pass --unit {sensor}={unit}, or --unit {sensor}={count} for the "
        "size of one count"
    )


def _find_acc(table: ForeignTable, told: ForeignMap) -> None:
    if "acc" in told.units or _named_unit("acc", told.columns["acc"][0], told):
        return
    rows = _readings(table, told, "acc")
    size = float(np.nanmedian(np.linalg.norm(rows, axis=1)))
    for unit, factor in (UNITS["acc"] | COUNTS["acc"]).items():
        if abs(size * factor / GRAVITY_M_S2 - 1.0) < GRAVITY_NEAR:
            _guess(told, "acc", unit, factor)
            return
    raise _which_unit(told, "acc", size, ("g", "0.000488g"))


def _find_mag(table: ForeignTable, told: ForeignMap) -> None:
    if "mag" not in told.columns or "mag" in told.units:
        return
    if _named_unit("mag", told.columns["mag"][0], told):
        return
    rows = _readings(table, told, "mag")
    rows = rows[np.isfinite(rows).all(axis=1)]
    middle = (rows.max(axis=0) + rows.min(axis=0)) / 2.0 if len(rows) else 0.0
    # The probe's own field moves the middle; what turns about it is the Earth's.
    sizes = [float(np.median(np.linalg.norm(rows - c, axis=1))) for c in (0.0, middle)]
    for size in sizes if len(rows) else ():
        for unit, factor in UNITS["mag"].items():
            if EARTH_UT[0] <= size * factor <= EARTH_UT[1]:
                _guess(told, "mag", unit, factor)
                return
    raise _which_unit(told, "mag", sizes[0], ("mG", "0.15uT"))


def _find_gyr(table: ForeignTable, told: ForeignMap, t_s: FloatArray) -> None:
    """Finds the unit with which gravity rotates in the body as the rates do."""
    if "gyr" in told.units or _named_unit("gyr", told.columns["gyr"][0], told):
        return
    acc = vector(table, told, "acc")
    rows = _readings(table, told, "gyr")
    factor = seen_turning(acc, rows, t_s)
    for unit, one in (UNITS["gyr"] | COUNTS["gyr"]).items():
        if factor is not None and abs(math.log(one / factor)) < math.log(1.5):
            _guess(told, "gyr", unit, one)
            return
    raise FileError(
        f"unknown unit of {', '.join(told.columns['gyr'])}: gravity does not rotate "
        "with them in any unit; pass one such as --unit gyr=deg/s, and check --axes"
    )


def _times_s(table: ForeignTable, told: ForeignMap) -> FloatArray:
    """Of rows, from the first one; notes what they are."""
    columns, rate_hz = told.columns.get("time", ()), told.rate_hz
    values = None
    if "time" in told.units and columns:
        values = table.columns[columns[0]]
        for name in columns[1:]:
            values = values + 1e-9 * table.columns[name]
    if rate_hz is not None:
        t_s = (told.rows + np.arange(len(table))) / rate_hz
    elif values is not None:
        t_s = _continued(columns[0], values, told)
    if told.rows == 0 and values is not None and np.isfinite(values).any():
        at = int(np.argmax(np.isfinite(values)))
        first_s = told.units["time"] * float(values[at])
        first_s -= at / rate_hz if rate_hz else 0.0
        if UTC_S[0] <= first_s < UTC_S[1]:
            told.began_s = first_s
            began = f"from {datetime.fromtimestamp(first_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
            told.note = ", ".join(filter(None, (told.note, began)))
    if rate_hz is not None:
        told.columns.pop("time", None)
    told.rows += len(table)
    return t_s


def _continued(name: str, values: FloatArray, told: ForeignMap) -> FloatArray:
    """Times of rows behind those of the tables before, s."""
    before, before_s = told.tail or (values[:0], values[:0])
    joined = np.concatenate([before, values])
    first_row = 1 + told.rows - len(before)
    t_s, note = straightened(name, joined, told.units["time"], first_row)
    t_s += before_s[0] if len(before) else 0.0
    told.note = told.note or note
    last = np.flatnonzero(np.isfinite(joined))[-TAIL:]
    told.tail = joined[last], t_s[last]
    return t_s[len(before) :]


def seen_turning(acc: FloatArray, gyr: FloatArray, t_s: FloatArray) -> float | None:
    """What a unit of the rate must be for gravity to turn with it, rad/s: in the body
    it turns by u' = -w x u. None if it hardly turned, or otherwise.
    """
    step = float(np.nanmedian(np.diff(t_s)))
    width = max(3, round(SMOOTH_S / step)) if step > 0.0 else 3
    if len(acc) < 4 * width:
        return None
    window = np.hanning(width + 2)[1:-1] / np.hanning(width + 2).sum()

    def smooth(rows: FloatArray) -> FloatArray:
        rows = np.nan_to_num(rows)
        each = [np.convolve(rows[:, axis], window, "valid") for axis in range(3)]
        return np.stack(each, axis=1)

    force, rate = smooth(acc), smooth(gyr - np.nanmedian(gyr, axis=0))
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    turned = np.gradient(up, step, axis=0)
    said = np.cross(up, rate)
    power = float((said**2).sum())
    if power <= 0.0:
        return None
    factor = float((turned * said).sum()) / power
    spread = float((turned**2).sum())
    alike = factor * factor * power / spread if spread > 0.0 else 0.0
    return factor if factor > 0.0 and alike > 0.3 else None
