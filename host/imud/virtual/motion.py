# SPDX-License-Identifier: MIT
"""What a virtual probe feels: read from a recording, or made by a hand of our own.

A motion is a row of records at a constant rate, each with the angular rate, the
specific force and the magnetic field in the sensor's frame. It reaches the simulator
as a binary stream. `docs/motion-files.md` describes the three formats.
"""

from __future__ import annotations

import csv
import math
import struct
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from imud import rotation
from imud.errors import FileError
from imud.rotation import FloatArray

BoolArray = npt.NDArray[np.bool_]

GRAVITY_M_S2 = 9.80665  # standard gravity, as the probe's own scale has it

STREAM_MAGIC = b"IMUMOT1\0"
# Magic, rate in Hz, records or 0: until the end, flags.
STREAM_HEADER = struct.Struct("<8sdQQ")
STREAM_RECORDED = 1

# Five records a sample of the chip at 200 Hz: its averaging sees a smooth motion.
HAND_RATE_HZ = 1000.0

CSV_COLUMNS = {
    "gyr": ("gyr_x_rad_s", "gyr_y_rad_s", "gyr_z_rad_s"),
    "acc": ("acc_x_m_s2", "acc_y_m_s2", "acc_z_m_s2"),
    "mag": ("mag_x_uT", "mag_y_uT", "mag_z_uT"),
}


class MotionError(FileError):
    """A motion cannot be read: which file, where in it, and why."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Records at a constant rate, with the truth about them where it is known.

    `quat` is world_from_body, world east-north-up; NaN where it was not seen.
    `is_recorded`: a sensor's low-pass is in it, which the simulator leaves out then.
    """

    rate_hz: float
    gyr: FloatArray  # rad/s, sensor frame
    acc: FloatArray  # specific force, m/s2, sensor frame: +g up at rest
    mag: FloatArray  # uT, sensor frame
    quat: FloatArray | None = None
    position: FloatArray | None = None  # of the sensor, m, world
    velocity: FloatArray | None = None  # of the sensor, m/s, world
    tip: FloatArray | None = None  # of the probe's tip, m, world
    movement: BoolArray | None = None  # to be scored: after the rest at the start
    is_rest: BoolArray | None = None  # lies still
    is_stroke: BoolArray | None = None  # the tip runs along the surface
    is_recorded: bool = True

    def __len__(self) -> int:
        return len(self.gyr)

    @property
    def seconds(self) -> float:
        """How long the motion lasts."""
        return len(self) / self.rate_hz

    def __getitem__(self, records: slice) -> Motion:
        arrays: dict[str, Any] = {
            entry.name: value[records]
            for entry in fields(self)
            if isinstance(value := getattr(self, entry.name), np.ndarray)
        }
        return replace(self, **arrays)

    def save(self, path: Path) -> None:
        """Writes a `.npz` that `load` and the benchmarks read."""
        arrays: dict[str, Any] = {
            "sampling_rate": np.array(self.rate_hz),
            "is_recorded": np.array(self.is_recorded),
        }
        for name, key in NPZ_KEYS.items():
            value = getattr(self, name)
            if value is not None:
                is_flag = value.dtype == np.bool_
                arrays[key] = value if is_flag else value.astype(np.float32)
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)


# Fields of Motion and their keys in a .npz: those of BROAD, then our own.
NPZ_KEYS = {
    "gyr": "gyr",
    "acc": "acc",
    "mag": "mag",
    "quat": "opt_quat",
    "position": "opt_pos",
    "movement": "movement",
    "velocity": "velocity",
    "tip": "tip_pos",
    "is_rest": "is_rest",
    "is_stroke": "is_stroke",
}
NPZ_WIDTHS = {"quat": 4, "movement": 0, "is_rest": 0, "is_stroke": 0}  # 3 otherwise


def load(path: Path) -> Motion:
    """Reads a recording, `.npz` or `.csv`."""
    readers = {".npz": load_npz, ".csv": load_csv}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise MotionError(f"{path}: a motion is a .npz or a .csv file")
    try:
        motion = reader(path)
    except OSError as error:
        raise MotionError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise MotionError(f"{path}: not a text file") from error
    if len(motion) < 2:
        raise MotionError(f"{path}: {len(motion)} records; at least 2 are needed")
    for name in CSV_COLUMNS:
        bad = np.flatnonzero(~np.isfinite(getattr(motion, name)).all(axis=1))
        if bad.size:
            raise MotionError(f"{path}: record {bad[0]}: {name} is not a finite number")
    return motion


def load_npz(path: Path) -> Motion:
    """Reads a `.npz` with the keys of BROAD; only sensors and rate are required."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(file):
            file.seek(0)
            archive = np.load(file, allow_pickle=False)
            stored = {key: archive[key] for key in archive.files}
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise MotionError(f"{path}: not a .npz of plain arrays: {error}") from error
    required = ("gyr", "acc", "mag", "sampling_rate")
    missing = [key for key in required if key not in stored]
    if missing:
        raise MotionError(f"{path}: no {', '.join(missing)} in it")
    if stored["sampling_rate"].size != 1:
        raise MotionError(f"{path}: sampling_rate is not one number")
    rate_hz = float(stored["sampling_rate"].reshape(-1)[0])
    if not (math.isfinite(rate_hz) and rate_hz > 0.0):
        raise MotionError(f"{path}: sampling_rate is {rate_hz:g} Hz")
    count = len(np.atleast_1d(stored["gyr"]))
    arrays: dict[str, Any] = {}
    for name, key in NPZ_KEYS.items():
        if key not in stored:
            continue
        width = NPZ_WIDTHS.get(name, 3)
        shape = (count, width) if width else (count,)
        if stored[key].shape != shape:
            raise MotionError(
                f"{path}: {key} has shape {stored[key].shape}, not {shape}"
            )
        arrays[name] = stored[key].astype(np.float64 if width else np.bool_)
    is_recorded = bool(np.all(stored.get("is_recorded", True)))
    return Motion(rate_hz=rate_hz, is_recorded=is_recorded, **arrays)


def load_csv(path: Path) -> Motion:
    """Reads a `.csv` whose first line names the columns, units and all."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(file)
        header = [name.strip() for name in next(rows, [])]
        wanted = ["t_s", *(name for names in CSV_COLUMNS.values() for name in names)]
        missing = [name for name in wanted if name not in header]
        if missing:
            raise MotionError(f"{path}:1: no column {', '.join(missing)}")
        places = [header.index(name) for name in wanted]
        values: list[list[float]] = []
        lines: list[int] = []
        for row in rows:
            if not row:
                continue
            try:
                values.append([float(row[place]) for place in places])
            except IndexError:
                raise MotionError(
                    f"{path}:{rows.line_num}: {len(row)} columns, not {len(header)}"
                ) from None
            except ValueError as error:
                raise MotionError(f"{path}:{rows.line_num}: {error}") from None
            lines.append(rows.line_num)
    if len(values) < 2:
        raise MotionError(f"{path}: {len(values)} records; at least 2 are needed")
    table = np.array(values)
    rate_hz = _constant_rate(path, table[:, 0], lines)
    return Motion(rate_hz, gyr=table[:, 1:4], acc=table[:, 4:7], mag=table[:, 7:10])


def _constant_rate(path: Path, t_s: FloatArray, lines: list[int]) -> float:
    steps = np.diff(t_s)
    usual = float(np.median(steps))
    if not usual > 0.0:
        raise MotionError(f"{path}:{lines[1]}: t_s does not increase")
    # Half a step: a missing or doubled row is further off than that, the rounding of
    # t_s to milliseconds is not, up to 500 Hz.
    bad = np.flatnonzero(~(np.abs(steps - usual) <= 0.5 * usual + 1e-9))
    if bad.size:
        raise MotionError(
            f"{path}:{lines[bad[0] + 1]}: {steps[bad[0]]:g} s after the record before, "
            f"where {usual:g} s are usual; a motion has a constant rate"
        )
    rate_hz = (len(t_s) - 1) / float(t_s[-1] - t_s[0])
    drift = np.abs(t_s - t_s[0] - np.arange(len(t_s)) / rate_hz) * rate_hz
    worst = int(np.argmax(drift))
    if drift[worst] > 1.0:
        raise MotionError(
            f"{path}:{lines[worst]}: {drift[worst]:.1f} records off a constant rate of "
            f"{rate_hz:g} Hz"
        )
    return rate_hz


def write_stream(file: IO[bytes], motions: Iterable[Motion], count: int = 0) -> None:
    """Writes the simulator's binary stream as far as the pieces of a motion go.

    A `count` of 0 leaves the number of records open. Each piece is flushed, so that
    whoever reads can begin at once.
    """
    is_begun = False
    for piece in motions:
        if not is_begun:
            flags = STREAM_RECORDED if piece.is_recorded else 0
            file.write(STREAM_HEADER.pack(STREAM_MAGIC, piece.rate_hz, count, flags))
            is_begun = True
        records = np.hstack([piece.gyr, piece.acc, piece.mag]).astype("<f4")
        file.write(records.tobytes())
        file.flush()


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What the sensor adds to the truth; an offset is drawn within plus and minus.

    The defaults are of the MPU-9250's product specification, revision 1.1, tables 1
    and 2 (total noise at 92 Hz, zero-rate and zero-g output), and of real rests.
    """

    gyr_noise_dps: float = 0.1
    acc_noise_mg: float = 8.0
    mag_noise_ut: float = 0.6
    gyr_offset_dps: float = 3.0
    acc_offset_mg: float = 60.0
    mag_offset_ut: float = 0.0  # of a calibrated magnetometer


NO_ERRORS = SensorErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

# The chip averages the motion as its low-pass does, over 0.443/f seconds. Noise that
# is to leave it with the data sheet's strength goes in stronger by as much.
NOISE_WINDOW_S = 0.443 / 92.0


@dataclass(frozen=True, slots=True)
class Magnet:
    """A dipole that stays where it is in the world."""

    position_m: tuple[float, float, float]
    moment_a_m2: tuple[float, float, float]

    def field_ut(self, position: FloatArray) -> FloatArray:
        """Its field at points of the world."""
        moment = np.array(self.moment_a_m2)
        away = position - np.array(self.position_m)
        distance = np.linalg.norm(away, axis=-1, keepdims=True)
        along = away / distance
        # mu0/4pi = 1e-7 T m/A
        parts = 3.0 * along * (along @ moment)[..., None] - moment
        return np.asarray(0.1 * parts / distance**3)


@dataclass(frozen=True, slots=True)
class World:
    """Where the hand works: the Earth's field, magnets nearby, the probe's length."""

    field_ut: float = 49.0
    dip_deg: float = 66.0  # the field points down by this, as in central Europe
    magnets: tuple[Magnet, ...] = ()
    tip_m: tuple[float, float, float] = (0.12, 0.0, 0.0)  # from the sensor, its frame

    def field_at(self, position: FloatArray) -> FloatArray:
        """The magnetic field at points of the world, uT; north is y."""
        dip = math.radians(self.dip_deg)
        earth = self.field_ut * np.array([0.0, math.cos(dip), -math.sin(dip)])
        total = np.broadcast_to(earth, position.shape)
        for magnet in self.magnets:
            total = total + magnet.field_ut(position)
        return total


@dataclass(frozen=True, slots=True)
class _Curve:
    """A quantity over time with its first two derivatives, in step."""

    value: FloatArray
    first: FloatArray
    second: FloatArray

    def __add__(self, other: _Curve) -> _Curve:
        return _Curve(
            self.value + other.value,
            self.first + other.first,
            self.second + other.second,
        )

    def __mul__(self, other: _Curve) -> _Curve:
        return _Curve(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value
            + 2.0 * self.first * other.first
            + self.value * other.second,
        )

    def along(self, vector: FloatArray) -> _Curve:
        """This scalar curve times a constant vector."""
        return _Curve(self.value * vector, self.first * vector, self.second * vector)


@dataclass(frozen=True, slots=True)
class _Turning:
    """An attitude over time with its rate and acceleration, in the body's frame."""

    quat: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    def then(self, other: _Turning) -> _Turning:
        """This attitude, with `other` turned further inside the body."""
        back = rotation.inverse(other.quat)
        rate = rotation.rotate(back, self.rate)
        acceleration = rotation.rotate(back, self.acceleration)
        return _Turning(
            rotation.multiply(self.quat, other.quat),
            rate + other.rate,
            acceleration - np.cross(other.rate, rate) + other.acceleration,
        )


def _about(axis: FloatArray, angle: _Curve) -> _Turning:
    """A turn about one axis that stays: rate and acceleration are the angle's."""
    turned = angle.along(axis)
    return _Turning(
        rotation.from_rotation_vector(turned.value), turned.first, turned.second
    )


# s(u) = 10u^3 - 15u^4 + 6u^5 goes from 0 to 1 with the least jerk, and
# b(u) = 64 u^3 (1-u)^3 from 0 to 1 at the middle and back; neither has speed or
# acceleration at its ends.
_STEP = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
_BUMP = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])


def _shape(polynomial: np.polynomial.Polynomial, u: FloatArray, span: float) -> _Curve:
    return _Curve(
        np.asarray(polynomial(u)),
        np.asarray(polynomial.deriv(1)(u)) / span,
        np.asarray(polynomial.deriv(2)(u)) / span**2,
    )


@dataclass(frozen=True, slots=True)
class _Waves:
    """A sum of sines for each of three axes: how a hand sways."""

    amplitude: FloatArray  # waves, 3
    pulsation: FloatArray  # rad/s
    phase: FloatArray

    @classmethod
    def draw(
        cls, random: np.random.Generator, bands: Iterable[tuple[float, float, float]]
    ) -> _Waves:
        """Five sines in each band of (lowest Hz, highest Hz, rms)."""
        table = np.repeat(np.array(list(bands)), 5, axis=0)
        low, high, rms = table.T[:, :, None]
        shape = (len(table), 3)
        return cls(
            amplitude=np.broadcast_to(rms * math.sqrt(2.0 / 5.0), shape),
            pulsation=2.0 * np.pi * random.uniform(low, high, shape),
            phase=random.uniform(0.0, 2.0 * np.pi, shape),
        )

    def at(self, t: FloatArray) -> _Curve:
        angle = self.pulsation * t[:, None, None] + self.phase
        swing = self.amplitude * np.sin(angle)
        speed = self.amplitude * self.pulsation * np.cos(angle)
        return _Curve(
            swing.sum(axis=1),
            speed.sum(axis=1),
            -(self.pulsation**2 * swing).sum(axis=1),
        )


@dataclass(frozen=True, slots=True)
class _Stance:
    """Where a leg of the motion begins or ends."""

    tip: FloatArray
    quat: FloatArray
    held: float  # 0 lies on its own, 1 is in the hand, which sways
    free: float  # 0 the tip is on the surface, 1 in the air


@dataclass(frozen=True, slots=True)
class _Leg:
    """One stretch from stance to stance, with least jerk, in a whole of records."""

    start: _Stance
    end: _Stance
    records: int
    bend: FloatArray = field(default_factory=lambda: np.zeros(3))  # m, at the middle
    is_rest: bool = False
    is_stroke: bool = False


_TURN_LIMIT = math.radians(450.0)  # rad/s at the peak of a turn
_PEAK = 1.875  # of a least-jerk step's speed over its mean speed


class _Hand:
    """Decides, leg by leg, what the probe does next; all chance comes from here."""

    def __init__(self, random: np.random.Generator, rate_hz: float) -> None:
        self.random = random
        self.rate_hz = rate_hz
        tip = np.array([*random.uniform(-0.1, 0.1, 2), 0.0])
        self.stance = _Stance(tip, self._lying(False), held=0.0, free=0.0)

    def legs(self) -> Iterator[_Leg]:
        """The rest at the start, then rounds in which everything comes up."""
        yield self._rest(3.0, 5.0)
        acts = [self._draw, self._draw, self._turn, self._regrip, self._put_down]
        while True:
            for index in self.random.permutation(len(acts)):
                yield from acts[index]()

    def _draw(self) -> Iterator[_Leg]:
        surface = np.array([*self.random.uniform(-0.15, 0.15, 2), 0.0])
        pen = self._pen()
        high = np.array([0.0, 0.0, self.random.uniform(0.03, 0.08)])
        yield self._go(surface, pen, 0.8, 1.4, free=0.0, bend=high)
        for _ in range(self.random.integers(2, 5)):
            yield self._go(surface, pen, 0.2, 0.6, free=0.0)
            length = self.random.uniform(0.05, 0.15)
            # Back towards the middle, so that the hand stays over its table.
            towards = math.atan2(-surface[1], -surface[0])
            towards += self.random.uniform(-0.9, 0.9)
            ahead = np.array([math.cos(towards), math.sin(towards), 0.0])
            aside = np.array([-ahead[1], ahead[0], 0.0])
            bend = aside * length * self.random.uniform(-0.15, 0.15)
            surface = surface + ahead * length
            lean = np.radians(self.random.uniform(-12.0, 12.0, 3))
            pen = rotation.multiply(pen, rotation.from_rotation_vector(lean))
            yield self._go(surface, pen, 0.6, 2.0, free=0.0, bend=bend, is_stroke=True)
        yield self._go(surface, pen, 0.2, 0.6, free=0.0)

    def _turn(self) -> Iterator[_Leg]:
        for _ in range(self.random.integers(2, 4)):
            heading, roll = self.random.uniform(-np.pi, np.pi, 2)
            pitch = math.asin(self.random.uniform(-1.0, 1.0))
            quat = rotation.from_heading_pitch_roll(heading, pitch, roll)
            tip = np.array([*self.random.uniform(-0.2, 0.2, 2), 0.25])
            tip[2] += self.random.uniform(-0.08, 0.08)
            yield self._go(tip, quat, 0.5, 1.5, free=1.0)

    def _regrip(self) -> Iterator[_Leg]:
        before = self.stance
        roll = self.random.choice([-1.0, 1.0]) * self.random.uniform(1.0, 2.1)
        tilt = self.random.uniform(-0.25, 0.25, 2)
        twist = rotation.from_rotation_vector(np.array([roll, *tilt]))
        lifted = np.array([before.tip[0], before.tip[1], before.tip[2] + 0.03])
        rolled = rotation.multiply(before.quat, twist)
        yield self._go(lifted, rolled, 0.35, 0.6, free=1.0)
        again = rotation.multiply(
            before.quat, rotation.from_rotation_vector(np.array([0.2 * roll, *tilt]))
        )
        yield self._go(lifted, again, 0.35, 0.6, free=1.0)

    def _put_down(self) -> Iterator[_Leg]:
        down = np.array([*self.random.uniform(-0.2, 0.2, 2), 0.0])
        high = np.array([0.0, 0.0, self.random.uniform(0.02, 0.06)])
        is_upside_down = bool(self.random.random() < 0.3)
        lying = self._lying(is_upside_down)
        yield self._go(down, lying, 0.9, 1.5, free=0.0, held=0.0, bend=high)
        yield self._rest(2.0, 4.0)

    def _rest(self, shortest_s: float, longest_s: float) -> _Leg:
        records = self._records(self.random.uniform(shortest_s, longest_s))
        return _Leg(self.stance, self.stance, records, is_rest=True)

    def _go(
        self,
        tip: FloatArray,
        quat: FloatArray,
        shortest_s: float,
        longest_s: float,
        *,
        free: float,
        held: float = 1.0,
        bend: FloatArray | None = None,
        is_stroke: bool = False,
    ) -> _Leg:
        start = self.stance
        self.stance = _Stance(tip, quat, held, free)
        change = rotation.multiply(rotation.inverse(start.quat), quat)
        angle = float(np.linalg.norm(rotation.to_rotation_vector(change)))
        seconds = max(
            self.random.uniform(shortest_s, longest_s), _PEAK * angle / _TURN_LIMIT
        )
        return _Leg(
            start,
            self.stance,
            self._records(seconds),
            bend=np.zeros(3) if bend is None else bend,
            is_stroke=is_stroke,
        )

    def _records(self, seconds: float) -> int:
        return max(2, round(seconds * self.rate_hz))

    def _lying(self, is_upside_down: bool) -> FloatArray:
        heading = self.random.uniform(-np.pi, np.pi)
        pitch, roll = np.radians(self.random.uniform(-3.0, 3.0, 2))
        if is_upside_down:
            roll += np.pi
        return rotation.from_heading_pitch_roll(heading, pitch, roll)

    def _pen(self) -> FloatArray:
        heading = self.random.uniform(-np.pi, np.pi)
        pitch = np.radians(self.random.uniform(45.0, 75.0))  # the tip points down
        roll = np.radians(self.random.uniform(-30.0, 30.0))
        return rotation.from_heading_pitch_roll(heading, pitch, roll)


class _Probe:
    """Turns legs into records: exact derivatives, then the sensor's errors."""

    def __init__(
        self, seed: int, rate_hz: float, world: World, errors: SensorErrors
    ) -> None:
        path_seed, sway_seed, noise_seed = np.random.SeedSequence(seed).spawn(3)
        self.hand = _Hand(np.random.default_rng(path_seed), rate_hz)
        sway = np.random.default_rng(sway_seed)
        # A slow sway and the physiological tremor of 8 to 12 Hz, rms in rad and m.
        self.turn_sway = _Waves.draw(sway, [(0.3, 2.0, 0.02), (8.0, 12.0, 0.001)])
        self.tip_sway = _Waves.draw(sway, [(0.3, 2.0, 0.003), (8.0, 12.0, 5e-5)])
        # The surface's grain, felt by the tip: micrometres at tens of Hz.
        self.grain = _Waves.draw(sway, [(20.0, 60.0, 4e-6)])
        self.noise = np.random.default_rng(noise_seed)
        self.rate_hz = rate_hz
        self.world = world
        self.errors = errors
        scale = np.array([math.radians(1.0), GRAVITY_M_S2 / 1000.0, 1.0])[:, None]
        spread = np.array(
            [[errors.gyr_offset_dps], [errors.acc_offset_mg], [errors.mag_offset_ut]]
        )
        self.offset = self.noise.uniform(-1.0, 1.0, (3, 3)) * spread * scale
        window = max(1.0, NOISE_WINDOW_S * rate_hz)
        sigma = np.array(
            [
                [errors.gyr_noise_dps * math.sqrt(window)],
                [errors.acc_noise_mg * math.sqrt(window)],
                # The AK8963 holds one instant: nothing is averaged.
                [errors.mag_noise_ut],
            ]
        )
        self.sigma = sigma * scale

    def motions(self) -> Iterator[Motion]:
        """One motion a leg, without end."""
        begun = 0
        for leg in self.hand.legs():
            yield self._feel(leg, begun)
            begun += leg.records

    def _feel(self, leg: _Leg, begun: int) -> Motion:
        count = leg.records
        t = (begun + np.arange(count)) / self.rate_hz
        u = np.arange(count) / count
        span = count / self.rate_hz
        step = _shape(_STEP, u[:, None], span)
        bump = _shape(_BUMP, u[:, None], span)

        turning = self._attitude(leg, t, step)
        tip = self._tip_path(leg, t, step, bump)
        offset = np.array(self.world.tip_m)
        lever_speed = np.cross(turning.rate, offset)
        lever_force = np.cross(turning.acceleration, offset)
        lever_force += np.cross(turning.rate, lever_speed)
        position = tip.value - rotation.rotate(turning.quat, offset)
        velocity = tip.first - rotation.rotate(turning.quat, lever_speed)
        acceleration = tip.second - rotation.rotate(turning.quat, lever_force)

        body_from_world = rotation.inverse(turning.quat)
        up = np.array([0.0, 0.0, GRAVITY_M_S2])
        felt = np.stack(
            [
                turning.rate,
                rotation.rotate(body_from_world, acceleration + up),
                rotation.rotate(body_from_world, self.world.field_at(position)),
            ],
            axis=1,
        )
        felt += self.offset + self.sigma * self.noise.standard_normal(felt.shape)
        return Motion(
            rate_hz=self.rate_hz,
            gyr=felt[:, 0],
            acc=felt[:, 1],
            mag=felt[:, 2],
            quat=turning.quat,
            position=position,
            velocity=velocity,
            tip=tip.value,
            movement=np.full(count, begun > 0),
            is_rest=np.full(count, leg.is_rest),
            is_stroke=np.full(count, leg.is_stroke),
            is_recorded=False,
        )

    def _attitude(self, leg: _Leg, t: FloatArray, step: _Curve) -> _Turning:
        change = rotation.to_rotation_vector(
            rotation.multiply(rotation.inverse(leg.start.quat), leg.end.quat)
        )
        still = np.zeros((len(t), 3))
        start = _Turning(np.broadcast_to(leg.start.quat, (len(t), 4)), still, still)
        turning = start.then(_about(change, step))
        sway = _blend(leg.start.held, leg.end.held, step) * self.turn_sway.at(t)
        for index, axis in enumerate(np.eye(3)):
            pick = slice(index, index + 1)
            angle = _Curve(
                sway.value[:, pick], sway.first[:, pick], sway.second[:, pick]
            )
            turning = turning.then(_about(axis, angle))
        return turning

    def _tip_path(self, leg: _Leg, t: FloatArray, step: _Curve, bump: _Curve) -> _Curve:
        still = np.zeros((len(t), 3))
        start = _Curve(np.broadcast_to(leg.start.tip, (len(t), 3)), still, still)
        path = start + step.along(leg.end.tip - leg.start.tip) + bump.along(leg.bend)
        path = path + _blend(leg.start.free, leg.end.free, step) * self.tip_sway.at(t)
        if leg.is_stroke:
            path = path + bump * self.grain.at(t)
        return path


def _blend(start: float, end: float, step: _Curve) -> _Curve:
    change = end - start
    return _Curve(
        start + change * step.value, change * step.first, change * step.second
    )


def stream(
    seed: int,
    rate_hz: float = HAND_RATE_HZ,
    world: World | None = None,
    errors: SensorErrors | None = None,
) -> Iterator[Motion]:
    """A hand-held probe without end: rests, strokes on a surface, turns, re-grips.

    Piece by piece, each continuing the one before. It starts with 3 to 5 s of rest;
    the same seed gives the same motion.
    """
    return _Probe(seed, rate_hz, world or World(), errors or SensorErrors()).motions()


def generate(
    seconds: float,
    seed: int,
    rate_hz: float = HAND_RATE_HZ,
    world: World | None = None,
    errors: SensorErrors | None = None,
) -> Motion:
    """The first seconds of `stream` in one piece."""
    records = max(1, round(seconds * rate_hz))
    pieces: list[Motion] = []
    gathered = 0
    for piece in stream(seed, rate_hz, world, errors):
        pieces.append(piece)
        gathered += len(piece)
        if gathered >= records:
            break
    return join(pieces)[:records]


def join(pieces: list[Motion]) -> Motion:
    """Pieces of one motion, in their order, as one."""
    arrays: dict[str, Any] = {
        entry.name: np.concatenate([getattr(piece, entry.name) for piece in pieces])
        for entry in fields(Motion)
        if isinstance(getattr(pieces[0], entry.name), np.ndarray)
    }
    return replace(pieces[0], **arrays)
