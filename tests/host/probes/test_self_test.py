# SPDX-License-Identifier: MIT
"""Verdicts on the sensors by what they answered to their stimulus."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from fakes import messages
from imud.probes.self_test import (
    ACC_PER_G,
    GYR_PER_DPS,
    Responses,
    SelfTestOutcome,
    SensorVerdict,
    adjusted,
    follows_range,
    judge,
    verdicts_of,
)

WHO, ADJUST = (0x71, 0x48), (176, 178, 166)
GOOD = Responses.of(messages.SELF_TEST)
HELLO = messages.HELLO | {"self_test": ("host_judges",)}


def changed(name: str, axis: int, value: float, of: Responses = GOOD) -> Responses:
    """With another value for one axis of one measurement."""
    values = list(getattr(of, name))
    values[axis] = round(value)
    return replace(of, **{name: tuple(values)})


def verdict(sensor: str, responses: Responses, **hello: Any) -> SensorVerdict:
    by_name = {v.sensor: v for v in verdicts_of(HELLO | hello, responses)}
    return by_name[sensor]


def outcomes(responses: Responses) -> list[str]:
    return [v.outcome for v in judge(responses, WHO, ADJUST)]


def answering(axis: int, counts: float, code: int) -> Responses:
    """With that response and factory code in one axis, measured without motion."""
    still = replace(GOOD, before=GOOD.after)
    coded = changed("factory", axis, code, still)
    return changed("stimulated", axis, still.after[axis] + counts, coded)


def test_good_sensors_pass() -> None:
    assert outcomes(GOOD) == ["passed"] * 3
    assert all(not v.reason for v in judge(GOOD, WHO, ADJUST))


@pytest.mark.parametrize("code", [1, 2, 93, 150])
@pytest.mark.parametrize(
    ("ratio", "outcome"),
    [(0.49, "failed"), (0.51, "passed"), (1.49, "passed"), (1.51, "failed")],
)
def test_an_accelerometer_answers_half_to_one_and_a_half_of_its_factory_value(
    code: int, ratio: float, outcome: str
) -> None:
    factory = 2620 * 1.01 ** (code - 1)
    for axis in range(3):
        assert outcomes(answering(axis, ratio * factory, code))[0] == outcome


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("ratio", "outcome"), [(0.49, "failed"), (0.51, "passed")])
def test_a_gyroscope_answers_more_than_half_of_its_factory_value_in_either_direction(
    sign: int, ratio: float, outcome: str
) -> None:
    for axis in (3, 4, 5):
        counts = sign * ratio * 2620 * 1.01**137
        assert outcomes(answering(axis, counts, 138))[1] == outcome


def test_an_accelerometer_that_answers_in_the_wrong_direction_fails() -> None:
    assert outcomes(answering(0, -6500, 93)) == ["failed", "passed", "passed"]


@pytest.mark.parametrize(
    ("axis", "counts", "outcome"),
    [
        (0, 0.224 * ACC_PER_G, "failed"),
        (1, 0.226 * ACC_PER_G, "passed"),
        (2, -0.674 * ACC_PER_G, "passed"),
        (0, 0.676 * ACC_PER_G, "failed"),
        (3, 59.9 * GYR_PER_DPS, "failed"),
        (4, 60.1 * GYR_PER_DPS, "passed"),
        (5, -60.1 * GYR_PER_DPS, "passed"),
    ],
)
def test_without_a_factory_code_fixed_limits_hold(
    axis: int, counts: float, outcome: str
) -> None:
    assert outcomes(answering(axis, counts, 0))[axis // 3] == outcome


@pytest.mark.parametrize(("dps", "outcome"), [(19.9, "passed"), (20.1, "not judged")])
def test_a_rate_beyond_20_deg_s_is_motion_not_an_offset(
    dps: float, outcome: str
) -> None:
    for sign in (1, -1):
        counts = round(sign * dps * GYR_PER_DPS)
        rates = {
            name: (*getattr(GOOD, name)[:5], counts) for name in ("before", "after")
        }
        offset = replace(
            GOOD, **rates, stimulated=(*GOOD.stimulated[:5], counts + 8000)
        )
        assert outcomes(offset)[1] == outcome


@pytest.mark.parametrize(
    ("axis", "by", "has_moved"),
    [(5, 2.4 * 131, False), (5, 2.6 * 131, True), (0, 800, False), (0, -840, True)],
)
def test_a_failure_while_the_probe_moved_is_no_verdict(
    axis: int, by: float, has_moved: bool
) -> None:
    dead = replace(GOOD, stimulated=GOOD.before)
    moved = changed("after", axis, GOOD.before[axis] + by, dead)
    expected = "not judged" if has_moved else "failed"
    assert outcomes(moved) == [expected, expected, "passed"]
    assert moved.has_moved == has_moved
    if has_moved:
        words = "accelerometer not judged: the probe moved"
        assert judge(moved, WHO, ADJUST)[0].words == words


def test_sensors_that_answer_all_the_same_pass_while_the_probe_moves() -> None:
    assert outcomes(changed("after", 3, 600)) == ["passed"] * 3


@pytest.mark.parametrize(
    ("response", "outcome"),
    [
        ((160, -160, -1900), "passed"),
        ((180, 0, -1900), "failed"),
        ((0, -180, -1900), "failed"),
        ((1, 1, -690), "failed"),
        ((1, 1, -700), "passed"),
        ((1, 1, -2780), "passed"),
        ((1, 1, -2790), "failed"),
        ((0, 0, 0), "failed"),
    ],
)
def test_a_magnetometer_measures_its_coil_within_the_limits_once_adjusted(
    response: tuple[int, ...], outcome: str
) -> None:
    # By ADJUST a count is 1.1875, 1.1953 and 1.1484.
    assert outcomes(replace(GOOD, mag_response=response))[2] == outcome


def test_the_adjustment_of_a_magnetometer_is_half_to_one_and_a_half() -> None:
    assert adjusted((1000, 1000, 1000), (0, 128, 255)) == [500, 1000, 1496.09375]


def test_without_a_magnetometer_there_is_no_verdict_on_one() -> None:
    nothing = replace(GOOD, mag_response=(0, 0, 0))
    sensors = [v.sensor for v in judge(nothing, (0x70, 0), (0, 0, 0))]
    assert sensors == ["accelerometer", "gyroscope"]


def test_a_failure_names_axis_response_and_limits() -> None:
    dead = answering(1, 12, 95)
    assert judge(dead, WHO, ADJUST)[0].words == (
        "accelerometer failed: y response 1 mg, expected 204 to 611"
    )
    dull = answering(5, 131, 113)
    assert judge(dull, WHO, ADJUST)[1].words == (
        "gyroscope failed: z response 1 deg/s, expected at least 30"
    )
    silent = replace(GOOD, mag_response=(0, 0, 0))
    assert judge(silent, WHO, ADJUST)[2].words == (
        "magnetometer failed: it did not measure the field of its own coil"
    )


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ((), []),
        (("acc_passed", "gyr_passed", "mag_passed"), ["passed"] * 3),
        (("acc_failed", "gyr_passed"), ["failed", "passed"]),
        (("acc_passed", "mag_failed"), ["passed", "not judged", "failed"]),
    ],
)
def test_a_probe_that_judges_itself_is_believed(
    flags: tuple[str, ...], expected: list[str]
) -> None:
    hello = messages.HELLO | {"self_test": flags}
    assert [v.outcome for v in verdicts_of(hello, GOOD)] == expected


def test_without_the_responses_nothing_is_judged() -> None:
    unheard = [SelfTestOutcome.NOT_JUDGED] * 3
    assert [v.outcome for v in verdicts_of(HELLO, None)] == unheard


@pytest.mark.parametrize(
    ("force_g", "expected"), [(1.0, True), (0.6, True), (8.0, False), (0.12, False)]
)
def test_a_range_register_with_effect_gives_the_same_force_at_both_ranges(
    force_g: float, expected: bool
) -> None:
    assert follows_range(GOOD, force_g) is expected


def test_a_probe_that_moved_shows_nothing_about_its_ranges() -> None:
    assert follows_range(changed("after", 3, 600), 1.0) is None
    assert follows_range(GOOD, 0.0) is None
