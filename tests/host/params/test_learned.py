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
def test_a_filter_continues_with_a_learned_calibration(name: str) -> None:
    assert goes(learned(name, 1), learned(name, 2))
    assert goes(learned(name, 1, method="positions"), learned(name, 2))
    assert goes(Params(), learned(name))


def test_a_filter_continues_with_three_learned_sensors() -> None:
    new = Params()
    for name in SENSORS:
        new = learned(name, of=new)
    assert goes(Params(), new)


@pytest.mark.parametrize("method", ["positions", "wave", "measured", "unknown"])
def test_a_filter_restarts_after_another_procedure(method: str) -> None:
    new = learned("mag", 2, method=method)
    assert not goes(learned("mag", 1), new)
    assert not goes(Params(), new)


def test_one_sensor_that_was_not_learned_restarts_the_filter() -> None:
    both = learned("acc", 2, of=learned("mag", 2, method="wave"))
    assert not goes(Params(), both)
    assert not goes(learned("acc", of=learned("mag")), both)
    # It is no matter of a sensor that stays as it was.
    assert goes(learned("mag", 2, method="wave"), both)


def test_params_without_a_calibration_do_not_restart_the_filter() -> None:
    tip = {"offset_m": [0.1, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]}
    assert goes(GOOD, GOOD)
    assert goes(GOOD, GOOD.replaced("options", {"button_does": "stream"}))
    assert goes(GOOD, GOOD.replaced("tip", tip))
    assert goes(GOOD, GOOD.without("options"))


def test_a_filter_restarts_without_known_earlier_params() -> None:
    assert not goes(None, learned("acc"))
    assert not goes(None, Params())


@pytest.mark.parametrize("damaged", [OLD[:-1], b"\x01", OLD + OLD[:2], OLD + OLD])
def test_a_filter_restarts_with_damaged_records(damaged: bytes) -> None:
    assert not filter_can_continue(damaged, OLD)
    assert not filter_can_continue(OLD, damaged)
    assert not filter_can_continue(damaged, damaged)


def test_a_filter_restarts_with_rotated_axes() -> None:
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
def test_a_filter_restarts_if_a_calibration_is_removed(name: str) -> None:
    assert not goes(learned(name), Params())


def test_a_record_that_is_too_short_calibrates_nothing() -> None:
    short = b"\x01\x05" + bytes(5)
    assert not filter_can_continue(learned("acc").encode(), short)
    assert filter_can_continue(short, learned("acc").encode())


def test_a_filter_restarts_with_another_gyroscope_bias() -> None:
    values = {"bias_counts": [1.0, 0.0, 0.0], "matrix": EYE, "method": "learned"}
    assert not goes(learned("gyr", 1), Params().replaced("gyr", values))
    assert not goes(Params(), Params().replaced("gyr", values))
