# SPDX-License-Identifier: MIT
"""Rows on the sensors' readings at rest, axis by axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from imud.calibration.noise import density
from imud.calibration.recording import COUNT_MAX
from imud.check import limits
from imud.check.evidence import Evidence, Samples
from imud.check.rows import Row, RowVerdict, graded, skipped, worst
from imud.gravity import GRAVITY_M_S2
from imud.probes.chip import Chip, chip_of
from imud.probes.self_test import AXES
from imud.rotation import FloatArray
from imud.wire.params import parts_of

BoolArray = npt.NDArray[np.bool_]

MG = GRAVITY_M_S2 / 1000.0
DEG = math.degrees(1.0)

# A window counts as rest if nothing in it deviates by more. A hand is never so still;
# noise of ten times the data sheet's still is.
WINDOW_S = 0.5
STILL_DPS = 1.5
STILL_MG = 80.0
REST_MIN_S = 4.0
SAME = 0.95  # the cosine of 18 degrees
STUCK_S = 1.0
ALL = "all"
NOISE_FAULT = 6.0  # times the limit
NOISE_GOOD = 1.5
SPARSE = 1.1  # samples that the sensor made, for each; noise of left out ones is missed
LOUDER = 2.0  # times the noise of the calibration; ten seconds tell it to 6 %

# Twice the noise of a good chip is no tone. A hand moves slower.
VIBRATION_MG, VIBRATION_MIN_HZ = 10.0, 2.0
FLAT_MG = 350.0  # with more aside it does not lie base down


@dataclass(frozen=True, slots=True)
class RestReadings:
    """Means and noise of the samples of a probe at rest."""

    seconds: float
    acc_mg: FloatArray  # means
    gyr_dps: FloatArray
    acc_noise_mg: FloatArray  # rms within windows
    gyr_noise_dps: FloatArray
    mag_noise_ut: FloatArray  # NaN: no readings
    densities: Mapping[str, float | None] = field(default_factory=dict)  # of SI units

    @property
    def is_enough(self) -> bool:
        return self.seconds >= REST_MIN_S


def rest_of(evidence: Evidence, samples: Samples) -> RestReadings:
    """From all windows of the samples in which the probe did not move."""
    nothing = np.full(3, np.nan)
    period_us = samples.period_us
    size = round(WINDOW_S * 1e6 / period_us) if period_us > 0 else 0
    if size < 4:
        return RestReadings(0.0, *(nothing,) * 5)
    count = len(samples) // size
    hello = evidence.hello

    def windows(values: FloatArray, scale: float) -> FloatArray:
        return values[: count * size].reshape(count, size, 3) * scale

    acc = windows(samples.acc, hello["acc_lsb"] / MG)
    gyr = windows(samples.gyr, hello["gyr_lsb"] * DEG)
    mag = windows(samples.mag, hello["mag_lsb"])
    acc_std, gyr_std = acc.std(axis=1), gyr.std(axis=1)
    still = (acc_std.max(axis=1) < STILL_MG) & (gyr_std.max(axis=1) < STILL_DPS)
    if still.any():
        still &= _is_mostly(acc.mean(axis=1), still)
    if not still.any():
        return RestReadings(0.0, *(nothing,) * 5)
    densities = {}
    if period_us * 1e-6 * hello["sample_rate"] < SPARSE:
        for name, values in (("acc", acc * MG), ("gyr", gyr / DEG)):
            densities[name] = density(values[still], period_us * 1e-6)
    return RestReadings(
        float(still.sum()) * size * period_us * 1e-6,
        acc[still].mean(axis=(0, 1)),
        gyr[still].mean(axis=(0, 1)),
        _rms(acc_std[still]),
        _rms(gyr_std[still]),
        _mag_noise(mag[still]),
        densities,
    )


def _is_mostly(means: FloatArray, still: BoolArray) -> BoolArray:
    """The still windows in the most frequent attitude."""
    usual = np.median(means[still], axis=0)
    share = means @ usual / np.linalg.norm(means, axis=1) / np.linalg.norm(usual)
    return np.asarray(share > SAME)


def longest_run(values: FloatArray) -> int:
    """The most samples in a row with the same number."""
    changes = np.flatnonzero(np.diff(values) != 0)
    ends = np.concatenate([[-1], changes, [len(values) - 1]])
    return int(np.diff(ends).max())


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _mag_noise(mag: FloatArray) -> FloatArray:
    """Rms within windows, without missing readings."""
    stds = [
        window[fresh].std(axis=0)
        for window in mag
        if (fresh := np.isfinite(window[:, 0])).sum() > 3
    ]
    return _rms(np.array(stds)) if stds else np.full(3, np.nan)


def rows(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """Of accelerometer, gyroscope, temperature and supply."""
    yield _supply(evidence)
    if len(samples) < 10:
        return
    stuck = _stuck(samples)
    yield stuck
    if stuck.measured == ALL:
        return
    seconds = len(samples) * samples.period_us * 1e-6
    rest = rest_of(evidence, samples)
    yield _saturation(samples)
    yield _temperature(samples)
    yield from _vibration(evidence, samples)
    if evidence.causes_of("sensor_fault")["registers"]:
        yield skipped("rest", "registers as set", "a register was wrong")
        return
    if seconds < REST_MIN_S:
        yield skipped("rest", f"{REST_MIN_S:g} s at least", f"{seconds:.1f} s in total")
        return
    if not rest.is_enough:
        yield Row(
            "rest",
            f"{rest.seconds:.1f} s",
            f"{REST_MIN_S:g} s at least",
            RowVerdict.LOOK,
            "it moved, or its noise is large: noise and offsets were not judged. Lay "
            "it on a table, without a fan or a keyboard on it, and check again",
        )
        return
    chip = chip_of(evidence.hello)
    for name, noise, limit, unit, digits in (
        ("gyroscope", rest.gyr_noise_dps, chip.gyr_noise_dps, "deg/s", 3),
        ("accelerometer", rest.acc_noise_mg, chip.acc_noise_mg, "mg", 1),
    ):
        times = _times(evidence, rest, name[:3])
        yield _noise(f"{name} noise", noise, limit, unit, digits, times)
    yield _gyr_offset(rest, chip)
    yield _acc_offset(rest, chip)


def _axes(values: FloatArray, digits: int) -> str:
    return ", ".join(
        f"{axis} {value:.{digits}f}" for axis, value in zip(AXES, values, strict=True)
    )


def _noise(
    name: str,
    noise: FloatArray,
    limit: float,
    unit: str,
    digits: int,
    times: float | None,
) -> Row:
    verdicts = [
        graded(value / limit, NOISE_GOOD, NOISE_FAULT) for value in noise.tolist()
    ]
    verdict = worst(verdicts)
    advice = ""
    if verdict is not RowVerdict.GOOD:
        loud = [
            AXES[i] for i, each in enumerate(verdicts) if each is not RowVerdict.GOOD
        ]
        advice = (
            f"more noise than normal on {', '.join(loud)}: the table shakes, the "
            "supply lacks capacitors, or the chip is bad"
        )
    measured = f"{_axes(noise, digits)} {unit} rms"
    numbers: dict[str, Any] = {"rms": _rounded(noise)}
    if times is not None:
        measured += f", {times:.1f} times that of its calibration"
        numbers["times"] = round(times, 3)
        if times > LOUDER:
            verdict = worst((verdict, RowVerdict.LOOK))
            advice = advice or (
                f"it is {times:.1f} times as noisy as when it was calibrated: the "
                "table shakes, a contact is loose, or this is another module"
            )
    normal = f"{limit:g} {unit} rms, up to {limit * NOISE_GOOD:g} is good"
    return Row(name, measured, normal, verdict, advice, numbers)


def _times(evidence: Evidence, rest: RestReadings, name: str) -> float | None:
    """Its noise against that of its calibration, by the params; None: not known."""
    then = parts_of(evidence.params or b"").get("noise", {}).get(name)
    now = rest.densities.get(name)
    return now / then if now and isinstance(then, float) and then > 0.0 else None


def _gyr_offset(rest: RestReadings, chip: Chip) -> Row:
    limit = chip.gyr_offset_dps
    verdict = worst(graded(each, limit, 4 * limit) for each in rest.gyr_dps.tolist())
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            f"the offset exceeds the limit of {chip.source}: did it move? The probe "
            "subtracts it at each start, but it hints at a bad or counterfeit chip"
        )
    measured = f"{_axes(rest.gyr_dps, 2)} deg/s"
    normal = f"± {limit:g} deg/s"
    numbers = {"dps": _rounded(rest.gyr_dps)}
    return Row("gyroscope offset", measured, normal, verdict, advice, numbers)


def _acc_offset(rest: RestReadings, chip: Chip) -> Row:
    """Base down, from the vertical; a table may slope. Otherwise only the length."""
    force = rest.acc_mg
    length = float(np.linalg.norm(force))
    name, numbers = "accelerometer offset", {"mg": _rounded(force)}
    scale_mg = 1000.0 * chip.acc_scale
    reach = math.hypot(*chip.acc_offset_mg)
    if math.hypot(force[0], force[1]) > FLAT_MG or force[2] < 0:
        verdict = graded(length - 1000.0, reach + scale_mg, 500.0)
        measured = f"{_axes(force, 0)} mg, {length:.0f} mg in total"
        normal = f"1000 ± {reach + scale_mg:.0f} mg in total"
    else:
        off = force - np.array([0.0, 0.0, 1000.0])
        slope = limits.SLOPE_MG
        allowed = np.add(chip.acc_offset_mg, (slope, slope, scale_mg))
        verdict = worst(graded(share, 1.0, 5.0) for share in (off / allowed).tolist())
        measured = f"{_axes(off, 0)} mg"
        bounds = ", ".join(f"{each:.0f}" for each in allowed)
        normal = f"± {bounds} mg (offset, scale, a table 2 degrees off)"
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "the resting force is not gravity: did it lie base down on a level table? "
            "If so, imud calibrate removes the offset; if it is large, the chip is "
            "broken or ignores its range setting"
        )
    return Row(name, measured, normal, verdict, advice, numbers)


def _stuck(samples: Samples) -> Row:
    """An axis whose number does not change; noise moves each by several counts."""
    limit = STUCK_S * 1e6 / samples.period_us
    stuck = [
        f"{name} {AXES[axis]}"
        for name, values in (("accelerometer", samples.acc), ("gyroscope", samples.gyr))
        for axis in range(3)
        if longest_run(values[:, axis]) > limit
    ]
    normal = "each axis has noise"
    if not stuck:
        return Row("stuck axes", "none", normal, RowVerdict.GOOD)
    measured = ALL if len(stuck) == 6 else ", ".join(stuck)
    advice = (
        "readings do not change: the chip has hung (power it off and on) or is broken"
    )
    return Row("stuck axes", measured, normal, RowVerdict.FAULT, advice)


def _saturation(samples: Samples) -> Row:
    ends = (np.abs(np.hstack([samples.acc, samples.gyr])) >= COUNT_MAX).any(axis=1)
    count = int(np.count_nonzero(ends | (samples.clipped > 0)))
    share = count / len(samples)
    verdict = graded(share, 0.0, 0.01)
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "a sensor was at the end of its range: was the probe knocked? If it "
            "was at rest, an axis is broken"
        )
    measured = f"{count} of {len(samples)} samples"
    return Row("saturation", measured, "0", verdict, advice, {"samples": count})


def _vibration(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """One tone that stands out of the accelerometer's readings; of others no row."""
    count, rate_hz = len(samples), 1e6 / samples.period_us
    acc = samples.acc * (evidence.hello["acc_lsb"] / MG)
    window = np.hanning(count)
    lines = np.fft.rfft((acc - acc.mean(axis=0)) * window[:, None], axis=0)
    power = np.sum(np.abs(lines) ** 2, axis=1)
    freqs_hz = np.fft.rfftfreq(count, 1.0 / rate_hz)
    power[freqs_hz < VIBRATION_MIN_HZ] = 0.0  # hands
    at = int(power.argmax())
    tone = slice(max(0, at - 2), at + 3)  # a line of this window has five
    # The window's own power makes a line's rms.
    rms_mg = math.sqrt(2.0 * float(power[tone].sum()) / count / np.sum(window**2))
    if rms_mg < VIBRATION_MG or power[tone].sum() < power.sum() / 2.0:
        return
    hz = float(freqs_hz[at])
    others = [n * rate_hz + sign * hz for n in (1, 2) for sign in (-1, 1)]
    alike = ", ".join(f"{each:.1f}" for each in others)
    advice = (
        f"it vibrates at {hz:.1f} Hz, or at {alike} Hz ..., which look the same at "
        f"{rate_hz:.0f} samples a second: take it off the motor or damp it. Near a "
        f"multiple of {rate_hz:.0f} Hz a vibration looks like a tilt, and is not seen "
        "here"
    )
    yield Row(
        "vibration",
        f"{rms_mg:.0f} mg rms at {hz:.1f} Hz",
        f"no tone above {VIBRATION_MG:g} mg rms",
        RowVerdict.LOOK,
        advice,
        {"hz": round(hz, 2), "mg_rms": round(rms_mg, 1)},
    )


def _temperature(samples: Samples) -> Row:
    found = samples.temperature_c[np.isfinite(samples.temperature_c)]
    low, high = limits.WARM_DEGC
    normal = f"{low:g} to {high:g} degC"
    if not len(found):
        return Row(
            "temperature",
            "no reading",
            normal,
            RowVerdict.LOOK,
            "the chip reports no temperature: calibrations can't be corrected for it",
        )
    degc = float(np.median(found))
    verdict, advice = RowVerdict.GOOD, ""
    if not low <= degc <= high:
        is_odd = not limits.SPECIFIED_DEGC[0] <= degc <= limits.SPECIFIED_DEGC[1]
        verdict = RowVerdict.FAULT if is_odd else RowVerdict.LOOK
        advice = "unusual for a chip in a room: it is hot, or not genuine"
    measured = f"{degc:.1f} degC"
    return Row(
        "temperature", measured, normal, verdict, advice, {"degc": round(degc, 2)}
    )


def _supply(evidence: Evidence) -> Row:
    supply_mv = evidence.counters.get("supply")
    board = str(evidence.hello.get("board"))
    low, high, least = limits.SUPPLY_MV.get(board, limits.SUPPLY_MV["f405"])
    normal = f"{low / 1000:.1f} to {high / 1000:.1f} V"
    if not isinstance(supply_mv, int):
        return skipped("supply", normal, "the board does not measure it")
    verdict, advice = RowVerdict.GOOD, ""
    flags = (evidence.equipment or {}).get("power") or ()
    if not low <= supply_mv <= high:
        verdict = RowVerdict.FAULT if supply_mv < least else RowVerdict.LOOK
        advice = "out of range: try another cable, USB port or regulator"
    if "low" in flags or evidence.causes_of("battery_low"):
        verdict, advice = RowVerdict.FAULT, "the battery is empty: charge it"
    measured = f"{supply_mv / 1000:.2f} V"
    battery_v = (evidence.equipment or {}).get("battery_v")
    if battery_v is not None:
        measured += f", battery {battery_v:.2f} V"
    return Row("supply", measured, normal, verdict, advice, {"mv": supply_mv})


def _rounded(values: FloatArray) -> list[float]:
    return [round(value, 4) for value in values.tolist()]
