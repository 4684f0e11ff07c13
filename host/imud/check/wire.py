# SPDX-License-Identifier: MIT
"""Rows on the port, the clock, the firmware and how the probe started."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from imud.check import limits
from imud.check.evidence import Evidence, Samples
from imud.check.rows import Row, RowVerdict, graded, skipped
from imud.wire import kept, schema

# In so short a time the delay of a few messages looks like a wrong clock.
CLOCK_MIN_S = 4.0

HARD = ("brown_out", "watchdog", "hard_fault")


def rows(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """The rows on the link of the messages."""
    if evidence.is_live:
        yield _port(evidence)
        yield _latency(samples)
    yield _losses(evidence)
    yield _clock(evidence, samples)
    yield _firmware(evidence)
    yield _boots(evidence)


def _port(evidence: Evidence) -> Row:
    wire = evidence.wire
    normal = "a latency timer of 1 ms, where the adapter has one"
    if wire is None:
        return skipped("port", normal, "on another host")
    words = [wire.kind]
    if wire.baud:
        words.append(f"{wire.baud} baud")
    if wire.latency_timer_ms is not None:
        words.append(f"latency timer {wire.latency_timer_ms} ms")
    verdict, advice = RowVerdict.GOOD, ""
    if (wire.latency_timer_ms or 0) > 1:
        verdict = RowVerdict.LOOK
        advice = (
            "the adapter holds bytes back for up to "
            f"{wire.latency_timer_ms} ms: sudo imud install-service writes a udev "
            "rule that sets its latency timer to 1 ms"
        )
    return Row("port", ", ".join(words), normal, verdict, advice)


def _latency(samples: Samples) -> Row:
    age_ms = samples.age_us[np.isfinite(samples.age_us)] / 1000.0
    normal = f"median up to {limits.AGE_GOOD_MS:g} ms"
    if not len(age_ms):
        return skipped("latency", normal, "no dated samples")
    median, late = (float(each) for each in np.percentile(age_ms, (50, 99)))
    verdict = graded(median, limits.AGE_GOOD_MS, limits.AGE_FAULT_MS)
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "samples arrive late: the host is busy, or a hub or the adapter (its "
            "latency timer) delays them"
        )
    measured = f"{median:.1f} ms from sample to host, 99 % {late:.1f} ms"
    numbers = {"median_ms": round(median, 2), "p99_ms": round(late, 2)}
    bound_ms = samples.bound_us[np.isfinite(samples.bound_us)] / 1000.0
    if len(bound_ms):
        numbers["time_bound_ms"] = round(float(np.median(bound_ms)), 3)
        measured += f"; times ± {numbers['time_bound_ms']:.1f} ms"
    return Row("latency", measured, normal, verdict, advice, numbers)


def _losses(evidence: Evidence) -> Row:
    link = evidence.link or {}
    corrupt = int(link.get("corrupt") or 0)
    dropped = evidence.rise("messages_dropped")
    unread = evidence.rise("receive_lost")
    numbers = {
        "corrupt_frames": corrupt,
        "lost_messages": evidence.lost,
        "dropped_by_probe": dropped,
        "bytes_lost_by_probe": unread,
    }
    measured = f"{evidence.lost} messages lost, {corrupt} frames corrupt"
    if dropped or unread:
        measured += f", probe dropped {dropped} messages and {unread} bytes"
    verdict, advice = RowVerdict.GOOD, ""
    if any(numbers.values()):
        verdict = RowVerdict.LOOK
        advice = (
            "bytes are lost between probe and host: try another cable or USB port, "
            "without a hub, and close other programs that have the port open (screen, "
            "the Arduino IDE)"
        )
        if dropped and not corrupt:
            advice = "the link is too slow for all raw samples, which the check needs"
    return Row("messages lost", measured, "0", verdict, advice, numbers)


def clock_ppm(samples: Samples) -> tuple[float, float | None] | None:
    """How fast the probe's clock runs against the host's, and the bound of that; the
    bound is None in a log, which does not keep that of each time.
    """
    dated = np.flatnonzero(np.isfinite(samples.t_ns))
    dated = dated[len(dated) // 20 :]  # the first times of a session are the worst
    if len(dated) < 2:
        return None
    device_us = samples.t_us[dated]
    if (
        device_us[-1] - device_us[0] < CLOCK_MIN_S * 1e6
        or (np.diff(device_us) < 0).any()
    ):
        return None
    bound_us = samples.bound_us[dated]
    half = len(dated) // 2
    first, last = 0, len(dated) - 1
    bound: float | None = None
    if np.isfinite(bound_us[:half]).any() and np.isfinite(bound_us[half:]).any():
        age_us = device_us - device_us[0]
        first = int(np.nanargmin(bound_us[:half] + age_us[:half] * 1e-3))
        last = half + int(np.nanargmin(bound_us[half:] - age_us[half:] * 1e-3))
    host_us = (samples.t_ns[dated[last]] - samples.t_ns[dated[first]]) / 1000.0
    apart_us = device_us[last] - device_us[first]
    if host_us <= 0 or apart_us <= 0:
        return None
    if math.isfinite(bound_us[first] + bound_us[last]):
        bound = float((bound_us[first] + bound_us[last]) / host_us * 1e6)
    return float((apart_us / host_us - 1.0) * 1e6), bound


def _clock(evidence: Evidence, samples: Samples) -> Row:
    # An Arduino has one or the other.
    may_resonate = evidence.hello.get("board") in ("nano", "mega")
    normal = f"crystal {limits.CRYSTAL_PPM:g} ppm"
    if may_resonate:
        normal += f", ceramic resonator {limits.RESONATOR_PPM:g} ppm"
    spare = (evidence.equipment or {}).get("clock") == "spare"
    if spare or evidence.causes_of("clock_failed"):
        return Row(
            "clock",
            "runs from the processor's internal oscillator",
            normal,
            RowVerdict.FAULT,
            "the crystal does not run: a solder joint is bad, or it is broken; the "
            "probe works, but its times are accurate only to 1 %",
        )
    found = clock_ppm(samples)
    if found is None:
        return skipped("clock", normal, "no host times to compare with")
    ppm, bound = found
    doubt = bound or 0.0
    good = limits.RESONATOR_PPM if may_resonate else limits.CRYSTAL_PPM
    verdict = graded(max(0.0, abs(ppm) - doubt), good, limits.CLOCK_FAULT_PPM)
    kind = ""
    if verdict is RowVerdict.GOOD and may_resonate:
        is_crystal = abs(ppm) + doubt <= limits.CRYSTAL_PPM
        kind = " (as a crystal)" if is_crystal else ""
        if abs(ppm) - doubt > limits.CRYSTAL_PPM:
            kind = " (a ceramic resonator)"
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "the board's clock is off: does the firmware fit the crystal, and do the "
            "fuses select it (docs/nano.md)? imud corrects times"
        )
    measured = f"{ppm:+.0f} ppm" + ("" if bound is None else f" ± {bound:.0f}") + kind
    numbers = {
        "ppm": round(ppm, 1),
        "bound_ppm": None if bound is None else round(bound, 1),
    }
    return Row("clock", measured, normal, verdict, advice, numbers)


def _firmware(evidence: Evidence) -> Row:
    hello = evidence.hello
    theirs = hello.get("schema_fingerprint")
    normal = f"schema {schema.FINGERPRINT:08x}, as this imud"
    if not isinstance(theirs, int):
        return skipped("firmware", normal, "no hello was received")
    measured = f"{hello['board']}, {hello['firmware']}, schema {theirs:08x}"
    if theirs == schema.FINGERPRINT:
        return Row("firmware", measured, normal, RowVerdict.GOOD)
    if kept.find(theirs) is not None:
        advice = "older firmware, which imud reads: update it with imud flash"
        return Row("firmware", measured, normal, RowVerdict.LOOK, advice)
    advice = "firmware and imud have different schemas: flash the matching image"
    return Row("firmware", measured, normal, RowVerdict.FAULT, advice)


def _boots(evidence: Evidence) -> Row:
    normal = "no restart during the check"
    boots = evidence.boots
    if not boots:
        return skipped("start", normal, "no hello was received")
    causes = " and ".join(boots[-1].causes).replace("_", " ") or "unknown cause"
    measured = f"boot {boots[-1].number}, by {causes}"
    restarts = len(boots) - 1
    hard = [cause for boot in boots[1:] for cause in boot.causes if cause in HARD]
    if "hard_fault" in boots[-1].causes:
        hard.append("hard_fault")
    if not restarts and not hard:
        return Row("start", measured, normal, RowVerdict.GOOD)
    if restarts:
        measured += f"; restarts during the check: {restarts}"
    verdict = RowVerdict.FAULT if hard else RowVerdict.LOOK
    if "brown_out" in hard:
        advice = (
            "the supply drops out: try another cable or USB port, avoid unpowered "
            "hubs, and check 5 V and 3.3 V for a short"
        )
    elif hard:
        advice = "the firmware crashed: please send this report"
    else:
        advice = (
            "reset was pressed, or a program opened the port, which resets an Arduino "
            "(DTR)"
        )
    return Row("start", measured, normal, verdict, advice, {"restarts": restarts})
