# SPDX-License-Identifier: MIT
"""Whether a filter can go on where its calibration changes: if it was learned in motion
and the axes are the same."""

from __future__ import annotations

import pytest

from imud.params.learned import filter_can_continue
from imud.params.value import SENSORS, Params
from params_bench import EYE, GOOD, learned

OLD = GOOD.encode()


def turned(error: float) -> tuple[tuple[float, ...], ...]:
    """Axes that are turned by an angle as small as that."""
    return ((1.0, -error, 0.0), (error, 1.0, 0.0), (0.0, 0.0, 1.0))


def goes(old: Params | None, new: Params) -> bool:
    return filter_can_continue(None if old is None else old.encode(), new.encode())


@pytest.mark.parametrize("name", SENSORS)
def test_a_filter_goes_on_with_what_was_learned(name: str) -> None:
    assert goes(learned(name, 1), learned(name, 2))
    assert goes(learned(name, 1, method="positions"), learned(name, 2))
    assert goes(Params(), learned(name))


def test_a_filter_goes_on_with_three_sensors_that_were_learned() -> None:
    new = Params()
    for name in SENSORS:
        new = learned(name, of=new)
    assert goes(Params(), new)


@pytest.mark.parametrize("method", ["positions", "wave", "measured", "unknown"])
def test_a_filter_begins_anew_with_another_procedure(method: str) -> None:
    new = learned("mag", 2, method=method)
    assert not goes(learned("mag", 1), new)
    assert not goes(Params(), new)


def test_one_sensor_that_was_not_learned_is_enough_to_begin_anew() -> None:
    both = learned("acc", 2, of=learned("mag", 2, method="wave"))
    assert not goes(Params(), both)
    assert not goes(learned("acc", of=learned("mag")), both)
    # It is no matter of a sensor that stays as it was.
    assert goes(learned("mag", 2, method="wave"), both)


def test_what_calibrates_no_sensor_is_no_reason_to_begin_anew() -> None:
    tip = {"offset_m": [0.1, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]}
    assert goes(GOOD, GOOD)
    assert goes(GOOD, GOOD.replaced("options", {"button_does": "stream"}))
    assert goes(GOOD, GOOD.replaced("tip", tip))
    assert goes(GOOD, GOOD.without("options"))


def test_a_filter_begins_anew_where_nobody_knows_what_was_before() -> None:
    assert not goes(None, learned("acc"))
    assert not goes(None, Params())


@pytest.mark.parametrize("damaged", [OLD[:-1], b"\x01", OLD + OLD[:2], OLD + OLD])
def test_a_filter_begins_anew_where_records_are_damaged(damaged: bytes) -> None:
    assert not filter_can_continue(damaged, OLD)
    assert not filter_can_continue(OLD, damaged)
    assert not filter_can_continue(damaged, damaged)


def test_a_filter_begins_anew_where_axes_are_turned() -> None:
    for error, is_alike in ((0.0, True), (0.189, True), (0.191, False), (0.3, False)):
        for sign in (1, -1):
            new = learned("gyr", 2, matrix=turned(sign * error))
            assert goes(learned("gyr", 1), new) == is_alike
            assert goes(Params(), new) == is_alike
    shrunk = ((0.8, 0.0, 0.0), *EYE[1:])
    assert not goes(Params(), learned("gyr", matrix=shrunk))
    # Those of before count, not those of the chip.
    old = learned("gyr", 1, matrix=turned(0.3))
    assert goes(old, learned("gyr", 2, matrix=turned(0.35)))
    assert not goes(old, learned("gyr", 2, matrix=EYE))


@pytest.mark.parametrize("name", SENSORS)
def test_a_filter_begins_anew_without_a_calibration_that_there_was(name: str) -> None:
    assert not goes(learned(name), Params())


def test_a_record_that_is_too_short_calibrates_nothing() -> None:
    short = b"\x01\x05" + bytes(5)
    assert not filter_can_continue(learned("acc").encode(), short)
    assert filter_can_continue(short, learned("acc").encode())


def test_a_filter_begins_anew_where_rates_have_another_bias() -> None:
    values = {"bias_counts": [1.0, 0.0, 0.0], "matrix": EYE, "method": "learned"}
    assert not goes(learned("gyr", 1), Params().replaced("gyr", values))
    assert not goes(Params(), Params().replaced("gyr", values))
