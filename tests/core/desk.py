# SPDX-License-Identifier: MIT
"""The core's C with products that may not overflow, its twin in doubles, and loops over
numpy arrays: what the tests of the arithmetic and of the filter work on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

import native
from imud import rotation

HELPERS = ("loops", "fuse_twin")
TWIN_PARTS = ("fuse_twin_field", "fuse_twin_math")

ffi, lib = native.load(
    [
        *(
            path
            for path in sorted(native.CORE.rglob("*.c"))
            if path.stem != "fixed_mul"
        ),
        "tests/core/checked_mul.c",
        *(f"tests/core/{name}.c" for name in (*HELPERS, *TWIN_PARTS)),
    ],
    [
        *sorted(native.CORE.rglob("*.h")),
        *(f"tests/core/{name}.h" for name in HELPERS),
    ],
)

DEGREE = math.pi / 180
G = 9.80665
ONE = 2.0**30  # q2_30
RATE = 2.0**25  # q7_25, rad/s
FORCE = 2.0**21  # q11_21, m/s2
FIELD = 2.0**18  # q14_18, uT
TURN = 2.0**32 / (2 * math.pi)  # turn32, rad
INT32_MAX = 2**31 - 1
INT32_MIN = -(2**31)

# Counts as they are: of sensors without errors, and of sensors nobody knows.
EXACT = ffi.new("struct calibration *")
UNKNOWN = ffi.new("struct calibration *")
for _calibration in (EXACT, UNKNOWN):
    lib.calibration_clear(_calibration)
EXACT.acc.sigma = EXACT.mag.sigma = 0  # the gyroscope's scale is always learned

Array = npt.NDArray[Any]


def call(function: Any, *arguments: Any) -> Any:
    """Call a C function; arrays go as pointers to what its prototype wants there."""
    kinds = ffi.typeof(function).args
    return function(
        *(
            ffi.cast(kind, ffi.from_buffer(value))
            if isinstance(value, np.ndarray)
            else value
            for kind, value in zip(kinds, arguments, strict=True)
        )
    )


def dtype_of(kind: Any) -> np.dtype[Any]:
    """The numpy type whose arrays are arrays of a C struct.

    A vector or a quaternion becomes a row of its components.
    """
    if isinstance(kind, str):
        kind = ffi.typeof(kind)
    if kind.kind == "array":
        return np.dtype((dtype_of(kind.item), (kind.length,)))
    if kind.kind == "struct":
        if kind.cname == "struct vector":
            return np.dtype((np.int32, (3,)))
        if kind.cname == "struct counts":
            return np.dtype((np.int16, (3,)))
        names = [name for name, _ in kind.fields]
        if names == ["w", "x", "y", "z"]:
            return np.dtype((np.int32, (4,)))
        return np.dtype(
            {
                "names": names,
                "formats": [dtype_of(field.type) for _, field in kind.fields],
                "offsets": [field.offset for _, field in kind.fields],
                "itemsize": ffi.sizeof(kind),
            }
        )
    name = kind.cname.removeprefix("enum ").removesuffix("_t")
    return np.dtype({"_Bool": "bool"}.get(name, name))


def mapped(function: Any, *inputs: Array, width: int = 0, dtype: Any = np.int32) -> Any:
    """The results of a loop_ function, `width` numbers each where it is not 0."""
    count = len(inputs[0])
    out = np.zeros((count, width) if width else count, dtype)
    call(function, count, *inputs, out)
    return out


def rounded(values: Any, dtype: Any = np.int32) -> Array:
    return np.ascontiguousarray(np.round(values), dtype)


def norms(rows: Array) -> Array:
    return np.linalg.norm(rows.astype(float), axis=-1)


def unit_rows(random: np.random.Generator, count: int, width: int) -> Array:
    """Directions without preference."""
    rows = random.standard_normal((count, width))
    return rows / norms(rows)[:, None]


def identity_of(**fields: int) -> Any:
    """An MPU-9250 as its driver describes it; fields given take another's place."""
    known = {
        "kind": lib.SENSOR_MPU9250,
        "rate_hz": 200,
        "gyr_delay_us": 3900,
        "gyr_lsb_nrad_s": 1065264,
        "acc_lsb_nm_s2": 4788403,
        "mag_lsb_pt": 150000,
    }
    return ffi.new("struct sensor_identity *", known | fields)


def apart_deg(one: Array, other: Array) -> Array:
    """The angles between rows of quaternions of any length, degrees."""
    product = rotation.multiply(
        one.astype(float), rotation.inverse(other.astype(float))
    )
    return np.degrees(2 * np.arctan2(norms(product[..., 1:]), np.abs(product[..., 0])))


def tilt_deg(one: Array, other: Array) -> Array:
    """How far apart their verticals are, degrees."""
    up = np.array([0.0, 0.0, 1.0])
    rows = [
        rotation.rotate(rotation.inverse(q / norms(q)[..., None]), up)
        for q in (one.astype(float), other.astype(float))
    ]
    sine = norms(np.cross(*rows))
    return np.degrees(np.arctan2(sine, np.sum(rows[0] * rows[1], axis=-1)))


def heading_deg(one: Array, other: Array) -> Array:
    """How far apart their headings are, degrees, as BROAD counts them."""
    w, _, _, z = rotation.multiply(one / ONE, rotation.inverse(other)).T
    return np.degrees(2 * np.arctan2(np.abs(z), np.abs(w)))
