# SPDX-License-Identifier: MIT
"""The Earth's magnetic field of a place and day, by the World Magnetic Model."""

from __future__ import annotations

import datetime
from functools import cache
from typing import Any

import msgspec

from imud.errors import ParamsError
from imud.params.value import Params
from imud.wire.params import is_mag_off

COEFFICIENTS = "wmm/WMM_2025.COF"  # good until the end of 2029; later it drifts slowly

# Iron turns the field of a room by more than this, or makes it stronger or weaker. A
# magnetometer's own scale is known to some percent.
NORM_SHARE = 0.12
DIP_DEG = 5.0

NOMINAL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))  # matrix of a sensor


class Earth(msgspec.Struct, frozen=True):
    """The field of a place; `declination_deg`: from true to magnetic north, east
    positive.
    """

    norm_uT: float  # noqa: N815 - the unit's own spelling
    dip_deg: float
    declination_deg: float


@cache
def earth_at(
    latitude_deg: float, longitude_deg: float, altitude_m: float, day: datetime.date
) -> Earth:
    """The field at a place above the WGS 84 ellipsoid."""
    from pygeomag import GeoMag  # with its coefficients 30 ms, needed by few

    start = datetime.date(day.year, 1, 1)
    year = day.year + (day - start).days / 365.25
    found = GeoMag(coefficients_file=COEFFICIENTS).calculate(
        glat=latitude_deg,
        glon=longitude_deg,
        alt=altitude_m / 1000.0,
        time=year,
        allow_date_outside_lifespan=True,
    )
    return Earth(
        round(found.f / 1000.0, 3), round(float(found.i), 3), round(float(found.d), 3)
    )


def strangeness(earth: Earth, norm_ut: float, dip_deg: float) -> str | None:
    """How a measured field differs from the Earth's here; None: it does not."""
    share = norm_ut / earth.norm_uT - 1.0
    if abs(share) > NORM_SHARE:
        word = "strong" if share > 0.0 else "weak"
        return f"the field is {100.0 * abs(share):.0f} % too {word}: iron nearby"
    turned = dip_deg - earth.dip_deg
    if abs(turned) > DIP_DEG:
        word = "steep" if abs(dip_deg) > abs(earth.dip_deg) else "flat"
        return f"the field is {abs(turned):.0f} degrees too {word}: iron nearby"
    return None


def with_field(records: bytes, earth: Earth) -> bytes:
    """Params with the field of the place, by which a filter recognises iron, unless a
    calibration of the magnetometer states its errors, or they have it, or no room.
    """
    here = {"norm_uT": earth.norm_uT, "dip_deg": earth.dip_deg}
    try:
        params = Params.decode(records)
        if is_mag_off(records):
            return records
        mag: dict[str, Any] | None = params.plain("mag")
        mag = mag or {"bias_counts": (0.0,) * 3, "matrix": NOMINAL}
        norm, dip = mag.get("norm_uT") or 0.0, mag.get("dip_deg") or 0.0
        if mag.get("sigma_uT") is None and strangeness(earth, norm, dip):
            params = params.replaced("mag", mag | here)
        params.check()
    except ParamsError:
        return records
    return params.encode()
