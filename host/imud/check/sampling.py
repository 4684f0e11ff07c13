# SPDX-License-Identifier: MIT
"""Rows on the samples' times, and on missing samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from imud.check import limits
from imud.check.evidence import Evidence, Samples
from imud.check.rows import Row, RowVerdict, graded, skipped, worst
from imud.probes.chip import chip_of

# Steps longer than this share of a period have a sample missing in them.
MISSING = 1.5


def rows(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """Not judged without samples: the row of the bus gives the reason."""
    if len(samples) < 10:
        yield skipped("sample rate", "as set", "no samples")
        return
    yield _rate(evidence, samples)
    yield _missing(evidence, samples)


def _rate(evidence: Evidence, samples: Samples) -> Row:
    period_us = samples.period_us
    steps = samples.steps_us[samples.steps_us < MISSING * period_us]
    rate_hz = 1e6 / float(np.mean(steps))
    jitter_us = float(np.std(steps))
    nominal_hz = evidence.hello.get("raw_rate") or evidence.hello["sample_rate"]
    sample_hz = evidence.hello["sample_rate"]
    share = chip_of(evidence.hello).rate_share
    normal = f"{nominal_hz} Hz ± {100 * share:g} %, jitter up to 2 %"
    verdicts = [graded(rate_hz / nominal_hz - 1.0, share, 5 * share)]
    # Of fewer raw messages than samples the spacing is uneven by a whole sample.
    if nominal_hz == sample_hz:
        jitter = jitter_us / period_us
        verdicts.append(graded(jitter, limits.JITTER_GOOD, limits.JITTER_FAULT))
    verdict = worst(verdicts)
    advice = ""
    if verdict is not RowVerdict.GOOD:
        advice = (
            "samples are not evenly spaced: check the wire from the sensor's "
            "data-ready pin (INT, DRDY_G), and whether the chip is genuine"
        )
    measured = f"{rate_hz:.2f} Hz, jitter {jitter_us:.0f} us"
    numbers = {"rate_hz": round(rate_hz, 3), "jitter_us": round(jitter_us, 1)}
    return Row("sample rate", measured, normal, verdict, advice, numbers)


def _missing(evidence: Evidence, samples: Samples) -> Row:
    overruns = evidence.rise("overruns")
    gaps = samples.flags["gap"]
    numbers = {"overruns": overruns, "gaps": gaps}
    measured = f"{gaps} gaps, {overruns} overruns in {len(samples)} samples"
    verdict, advice = RowVerdict.GOOD, ""
    if gaps or overruns:
        verdict = RowVerdict.LOOK
        advice = (
            "the probe missed samples, see the row: sensor bus; overruns alone mean "
            "that processing took longer than a sample: please report them"
        )
    return Row("missed samples", measured, "0", verdict, advice, numbers)
