# SPDX-License-Identifier: MIT
"""Why errors of poses are withheld, in words, and when the journal tells it."""

from __future__ import annotations

import pytest

from imud.probes.withheld import (
    LASTING_S,
    NO_ERRORS,
    OF_HEADING,
    OF_TILT,
    WithheldWatch,
    sentences,
    withheld_of,
)
from imud.wire import schema

KNOWN = {"tilt_sigma_deg": 0.4, "heading_sigma_deg": 1.2, "flags": []}
NOTHING = {"tilt": None, "heading": None}


def pose(*flags: str, tilt: float | None = None, heading: float | None = None):
    return {"tilt_sigma_deg": tilt, "heading_sigma_deg": heading, "flags": [*flags]}


def test_what_is_stated_needs_no_reason():
    assert withheld_of(KNOWN) == NOTHING
    assert withheld_of({}) == NOTHING
    # A flag of a pose that states its errors is none either.
    assert withheld_of(KNOWN | {"flags": ["mag_absent"]}) == NOTHING


@pytest.mark.parametrize("flag", OF_HEADING)
def test_every_flag_that_takes_the_heading_has_its_reason(flag):
    found = withheld_of(pose(flag, tilt=0.4))
    assert found == {"tilt": None, "heading": OF_HEADING[flag]}
    assert hasattr(schema.PoseFlags, flag.upper())


@pytest.mark.parametrize("flag", OF_TILT)
def test_every_flag_that_takes_the_tilt_has_its_reason(flag):
    assert withheld_of(pose(flag))["tilt"] == OF_TILT[flag]


def test_a_magnet_is_the_reason_before_what_it_brings():
    found = withheld_of(pose("heading_free", "field_impossible", tilt=1.0))
    assert "magnet" in str(found["heading"])


def test_filters_that_state_nothing_are_no_concern():
    found = withheld_of(pose())
    assert found == {"tilt": NO_ERRORS, "heading": NO_ERRORS}
    assert sentences(found) == []


def test_one_reason_for_both_is_one_sentence():
    (sentence,) = sentences(withheld_of(pose("force_impossible")))
    assert sentence.startswith("no tilt and no heading: the accelerometer")


def test_what_passes_by_itself_is_no_concern():
    assert sentences(withheld_of(pose("starting", "heading_free"))) == []


def told(watch: WithheldWatch, one: object, seconds: int) -> list[str]:
    return [line for _ in range(seconds) for line in watch.follow(withheld_of(one))]


def test_a_reason_is_told_once_it_lasts_and_once_it_is_over():
    watch = WithheldWatch()
    magnet = pose("field_impossible", tilt=0.4)
    assert told(watch, KNOWN, 20) == []
    assert told(watch, magnet, LASTING_S) == []
    (line,) = told(watch, magnet, 60)
    assert line.startswith("no heading: the magnetic field can't be the Earth's")
    assert told(watch, KNOWN, 60) == ["its errors are available again"]


def test_a_flag_that_flickers_is_not_told():
    watch = WithheldWatch()
    for _ in range(20):
        assert told(watch, pose("field_unlike", tilt=0.4), LASTING_S - 1) == []
        assert told(watch, KNOWN, 1) == []
