# SPDX-License-Identifier: MIT
"""Rows on the sensor's bus, its identity, its configuration and its self-test."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from imud.check.evidence import Evidence, Samples
from imud.check.rows import Row, RowVerdict, skipped
from imud.gravity import GRAVITY_M_S2
from imud.journal.faults import OF_SENSOR, fault_words
from imud.probes.chip import DIES, NAMESAKES, die_of
from imud.probes.self_test import SelfTestOutcome, follows_range
from imud.probes.sensors import (
    MPU6500,
    NINE_AXES,
    PAIRS,
    identity_words,
)

SELF_TEST_NORMAL = {
    "accelerometer": "50 to 150 % of the factory's response",
    "gyroscope": "above 50 % of the factory's response",
    "magnetometer": "the field of its own coil",
}
# Causes for which a chip is refused, with its identity.
OF_IDENTITY = ("wrong_chip", "force")

# Causes that have rows of their own.
OF_OTHER_ROWS = ("registers", "mag_stuck", "mag_silent")

BUS_FAULTS = 20  # more of them in a minute are not a loose contact

# Of sensors whose driver judges it.
SELF_TEST_BY_DRIVER = "a response within the data sheet's limits"
BY_DRIVER = ("lsm9ds0", *PAIRS)


def rows(evidence: Evidence, samples: Samples) -> Iterator[Row]:
    """The rows on the bus, the inertial die, its registers and the self-test."""
    yield _bus(evidence, len(samples))
    yield _identity(evidence)
    yield _configuration(evidence)
    yield from _self_test(evidence)
    if evidence.responses is not None:
        yield _range(evidence, samples)


def is_dead(evidence: Evidence) -> bool:
    """Whether no samples arrive, from the start or from some time on."""
    no_sensor = evidence.hello.get("sensor") == "none"
    return no_sensor or evidence.counters.get("state") == "fault"


def _bus(evidence: Evidence, count: int) -> Row:
    own = [t for t in evidence.events if t.event in OF_SENSOR]
    reported = Counter((t.event, t.cause) for t in own if t.cause not in OF_OTHER_ROWS)
    # The probe counts the others, too.
    others = len(own) - reported.total()
    total = max(0, int(evidence.counters.get("bus_faults") or 0) - others)
    normal = "samples come, no failed transfers"
    numbers = {
        "faults": total,
        "causes": {f"{event} {cause}": n for (event, cause), n in reported.items()},
    }
    often = reported.most_common(1)[0][0] if reported else ("", "")
    cause = often[1].replace("_", " ")
    if is_dead(evidence):
        measured = f"samples stopped after {count}" if count else "no samples"
        measured += f" ({cause})" if cause else ""
        advice = _cure(evidence, often) or "see the other rows, and check the wiring"
        if often[1] in OF_IDENTITY:
            advice = "see the row: inertial chip"
        return Row("sensor bus", measured, normal, RowVerdict.FAULT, advice, numbers)
    if count == 0:
        advice = 'the probe sends no raw samples: set streams = ["pose", "raw"]'
        return Row("sensor bus", "no samples", normal, RowVerdict.LOOK, advice, numbers)
    if not total and not reported:
        measured = f"{count} samples, no failed transfers"
        return Row("sensor bus", measured, normal, RowVerdict.GOOD, "", numbers)
    words = f" ({cause})" if cause else ""
    recovered = evidence.counters.get("bus_recoveries", 0)
    measured = (
        f"{total} failed transfers since the start{words}, {recovered} recoveries"
    )
    advice = (
        "the bus is unreliable: use shorter wires (below 20 cm), better contacts, a "
        "level shifter at 5 V, and only one pair of pull-ups"
    )
    if often[0] == "sensor_fault":
        advice = _cure(evidence, often) or advice
    verdict = RowVerdict.FAULT if total > BUS_FAULTS else RowVerdict.LOOK
    return Row("sensor bus", measured, normal, verdict, advice, numbers)


def _cure(evidence: Evidence, kind: tuple[str, str]) -> str:
    """The journal's advice about the last event of a kind."""
    details = [t.detail for t in evidence.events if (t.event, t.cause) == kind]
    # The detail of a bus fault is how often it came in a row.
    detail = details[-1] if details and kind[0] == "sensor_fault" else 0
    return fault_words(*kind, detail, str(evidence.hello.get("board")))


def _identity(evidence: Evidence) -> Row:
    hello = evidence.hello
    sensor = hello.get("sensor")
    dies = (*DIES.items(), *NAMESAKES.items())
    of_sensor = {who: die.name for who, die in dies if die.sensor == sensor}
    named = [f"{name} 0x{who:02X}" for who, name in of_sensor.items()]
    normal = ", ".join(named) or "a chip that this firmware reads"
    identity, second = hello.get("who_am_i") or (0, 0)
    if hello.get("sensor") == "none" or not identity:
        refused = [t for t in evidence.events if t.cause in OF_IDENTITY]
        if not refused:
            return skipped("inertial chip", normal, "no answer")
        measured = identity_words(refused[-1].detail & 0xFF)
        advice = _cure(evidence, refused[-1][:2])
        return Row("inertial chip", measured, normal, RowVerdict.FAULT, advice)
    numbers = {"who_am_i": [identity, second]}
    measured = identity_words(identity, str(sensor))
    die = die_of(identity, str(sensor))
    if die is not None and die.is_untried:
        advice = (
            "untried: nobody has run this firmware with this chip. Please send this "
            "report, whether it works or not"
        )
        measured += ", untried"
        return Row("inertial chip", measured, normal, RowVerdict.LOOK, advice, numbers)
    if identity in NINE_AXES or (identity in of_sensor and identity != MPU6500):
        return Row("inertial chip", measured, normal, RowVerdict.GOOD, "", numbers)
    advice = (
        "an unknown identity: the chip works like an MPU-9250, but its limits may "
        "differ. Please send this report, and say what the module was sold as"
    )
    if identity == MPU6500 and not second:
        advice = "an MPU-6500, often sold as an MPU-9250: it works, without heading"
    return Row("inertial chip", measured, normal, RowVerdict.LOOK, advice, numbers)


def _configuration(evidence: Evidence) -> Row:
    normal = "registers hold what was written"
    reported = [each for each in evidence.events if each.cause == "registers"]
    if not reported:
        if is_dead(evidence):
            return skipped("configuration", normal, "no sensor")
        return Row("configuration", "no difference reported", normal, RowVerdict.GOOD)
    numbers = sorted({each.detail >> 8 & 0xFF for each in reported})
    named = ", ".join(f"0x{number:02X}" for number in numbers)
    measured = f"{len(reported)} differences, register {named}"
    advice = (
        "a register lost its value: the sensor's supply drops out briefly (check "
        "capacitors, cable and contacts); the probe sets the sensor up again each time"
    )
    return Row(
        "configuration",
        measured,
        normal,
        RowVerdict.FAULT,
        advice,
        {"registers": numbers, "count": len(reported)},
    )


def _self_test(evidence: Evidence) -> Iterator[Row]:
    """One row for each sensor that has a self-test."""
    if evidence.hello.get("sensor") in (None, "none"):
        yield skipped("self-test", "passed", "no sensor")
        return
    verdicts = evidence.verdicts()
    if not verdicts:
        yield skipped("self-test", "passed", "the probe has no self-test")
    is_by_driver = evidence.hello["sensor"] in BY_DRIVER
    for found in verdicts:
        outcome, advice = RowVerdict.GOOD, ""
        if found.outcome is SelfTestOutcome.FAILED:
            outcome = RowVerdict.FAULT
            advice = (
                f"the {found.sensor}'s response to its own stimulus is out of limits: "
                "power it off and on, and check again at rest; if it fails again, the "
                "chip is broken or counterfeit"
            )
        elif found.outcome is SelfTestOutcome.NOT_JUDGED:
            outcome = RowVerdict.SKIPPED
            if found.is_for_motion:
                outcome = RowVerdict.LOOK
                advice = "lay it still, then reset the probe and check again"
        yield Row(
            f"self-test {found.sensor}",
            found.result,
            SELF_TEST_BY_DRIVER if is_by_driver else SELF_TEST_NORMAL[found.sensor],
            outcome,
            advice,
            {
                f"{check.axis}_{check.what}": round(check.value, 1)
                for check in found.checks
            },
        )


def _range(evidence: Evidence, samples: Samples) -> Row:
    """The force at 2 g full scale, in the self-test, against that of raw samples."""
    name, normal = "range register", "the same force at both ranges"
    responses = evidence.responses
    if responses is None or not len(samples):
        return skipped(name, normal, "no samples")
    counts = np.linalg.norm(np.median(samples.acc, axis=0))
    force_g = float(counts) * evidence.hello["acc_lsb"] / GRAVITY_M_S2
    follows = follows_range(responses, force_g)
    measured = f"{responses.force_g:.2f} g at 2 g full scale, {force_g:.2f} g as set"
    if follows is None:
        return skipped(name, normal, "it moved during start-up")
    if follows:
        return Row(name, measured, normal, RowVerdict.GOOD)
    advice = (
        "readings do not follow the range register: the chip is a counterfeit, or "
        "another one. Accelerations are wrong by a constant factor; use another module"
    )
    return Row(name, measured, normal, RowVerdict.FAULT, advice)
