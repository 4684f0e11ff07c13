# SPDX-License-Identifier: MIT
"""Madgwick's filter in floats, for a probe without the C module.

Equations of "An efficient orientation filter for inertial and inertial/magnetic sensor
arrays", 2010. core/fusion/madgwick.c has the same in fixed point: the same start, the
same beta, and between two readings of the field the form of six axes.
"""

from math import sqrt

from . import wire

_BETA = 0.041  # rad/s, Madgwick's own value for nine axes
_SQRT_HALF = 0.70710678
_STEEP = 0.5  # of the vertical along the body's x
_VERTICAL = 1.0 / 64  # sine of the angle at which a field tells no north
_STEP_MAX_S = 0.05


class Madgwick:
    """`earth`: the quaternion w, x, y, z of earth_from_body; earth has x to the north
    and z up.
    """

    KIND = wire.FILTER_MADGWICK
    RATE_HZ = 100  # steps a second, at most

    def __init__(self):
        self.restart()

    def restart(self):
        self.earth = (_SQRT_HALF, 0.0, 0.0, -_SQRT_HALF)
        self._has_level = False
        self._has_heading = False

    def orientation(self):
        """world_from_body, whose world has x to the east: a quarter turn more."""
        w, x, y, z = self.earth
        half = _SQRT_HALF
        return half * (w - z), half * (x - y), half * (y + x), half * (z + w)

    def step(self, rate, force, field, seconds):
        """`rate`: rad/s; `force`: any unit; `field`: any unit, never 0, or None;
        `seconds`: since the step before.
        """
        has_start = self._has_level and (field is None or self._has_heading)
        if not has_start and self._start(force, field):
            return
        w, x, y, z = self.earth
        gx, gy, gz = rate
        dt = _STEP_MAX_S if seconds > _STEP_MAX_S else seconds
        half = 0.5 * dt
        # Equation 12.
        dw = -half * (x * gx + y * gy + z * gz)
        dx = half * (w * gx + y * gz - z * gy)
        dy = half * (w * gy - x * gz + z * gx)
        dz = half * (w * gz + x * gy - y * gx)
        direction = self._gradient(force, field)
        if direction is not None:
            beta = _BETA * dt
            sw, sx, sy, sz = direction
            w, x, y, z = w - beta * sw, x - beta * sx, y - beta * sy, z - beta * sz
        w, x, y, z = w + dw, x + dx, y + dy, z + dz
        norm = 1.0 / sqrt(w * w + x * x + y * y + z * z)
        self.earth = w * norm, x * norm, y * norm, z * norm

    def _gradient(self, force, field):
        """The direction of the gradient, equations 34 and 44; None: there is none."""
        w, x, y, z = self.earth
        fx, fy, fz = force
        square = fx * fx + fy * fy + fz * fz
        if square == 0:
            return None
        norm = 1.0 / sqrt(square)
        # The vertical in the body, and the objective of equation 25.
        ux, uy = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
        uz = 1.0 - 2.0 * (x * x + y * y)
        fx, fy, fz = ux - fx * norm, uy - fy * norm, uz - fz * norm
        sw = sx = sy = sz = 0.0
        if field is not None:
            mx, my, mz = field
            norm = 1.0 / sqrt(mx * mx + my * my + mz * mz)
            mx, my, mz = mx * norm, my * norm, mz * norm
            # North in the body, and the reference, equations 45 and 46.
            nx, ny = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z)
            nz = 2.0 * (x * z + w * y)
            bz = ux * mx + uy * my + uz * mz
            north = nx * mx + ny * my + nz * mz
            # West is the vertical across north.
            west = (
                (uy * nz - uz * ny) * mx
                + (uz * nx - ux * nz) * my
                + (ux * ny - uy * nx) * mz
            )
            bx = sqrt(north * north + west * west)
            # Equation 29.
            mx = bx * nx + bz * ux - mx
            my = bx * ny + bz * uy - my
            mz = bx * nz + bz * uz - mz
            fx, fy, fz = fx + bz * mx, fy + bz * my, fz + bz * mz
            mx, my, mz = bx * mx, bx * my, bx * mz
            sw = y * mz - z * my
            sx = y * my + z * mz
            sy = x * my + w * mz - 2.0 * y * mx
            sz = x * mz - w * my - 2.0 * z * mx
        sw += x * fy - y * fx
        sx += z * fx + w * fy - 2.0 * x * fz
        sy += z * fy - w * fx - 2.0 * y * fz
        sz += x * fx + y * fy
        square = sw * sw + sx * sx + sy * sy + sz * sz
        if square < 1e-12:  # single precision knows no direction
            return None
        norm = 1.0 / sqrt(square)
        return sw * norm, sx * norm, sy * norm, sz * norm

    def _start(self, force, field):
        """The first force levels it, the first field turns it to north. True where the
        filter must not step with this sample.
        """
        finds_level = not self._has_level
        if finds_level:
            up = _unit(force)
            if up is None:
                return True
            # A north for now: across the vertical and the body's x, which is east; or y
            # where x is steep.
            is_steep = abs(up[0]) > _STEEP
            hint = (-up[2], 0.0, up[0]) if is_steep else (0.0, up[2], -up[1])
        else:
            w, x, y, z = self.earth
            up = (
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                1.0 - 2.0 * (x * x + y * y),
            )
            hint = None
        self._has_level = True
        facing = _facing(_unit(field), up) if field is not None else None
        self._has_heading = facing is not None
        if facing is None:
            if not finds_level:
                return False
            facing = _facing(hint, up)
        north, west = facing
        self.earth = _from_rows(north, west, up)
        return True


def _unit(vector):
    square = sum(part * part for part in vector)
    if square == 0:
        return None
    norm = 1.0 / sqrt(square)
    return tuple(part * norm for part in vector)


def _cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _facing(north, up):
    """North and west, level; None where `north` is within a degree of the vertical."""
    if north is None:
        return None
    east = _cross(north, up)
    if sum(part * part for part in east) < _VERTICAL * _VERTICAL:
        return None
    east = _unit(east)
    return _cross(up, east), tuple(-part for part in east)


def _from_rows(a, b, c):
    """The unit quaternion of a rotation, by its rows."""
    trace = a[0] + b[1] + c[2]
    squares = [1 + 2 * part - trace for part in (a[0], b[1], c[2])]
    largest = max(1 + trace, *squares)  # four times the square of that part
    if largest == 1 + trace:
        quat = largest, c[1] - b[2], a[2] - c[0], b[0] - a[1]
    elif largest == squares[0]:
        quat = c[1] - b[2], largest, a[1] + b[0], a[2] + c[0]
    elif largest == squares[1]:
        quat = a[2] - c[0], a[1] + b[0], largest, b[2] + c[1]
    else:
        quat = b[0] - a[1], a[2] + c[0], b[2] + c[1], largest
    scale = 0.5 / sqrt(largest)
    return tuple(part * scale for part in quat)
