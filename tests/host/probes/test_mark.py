# SPDX-License-Identifier: MIT
"""How far the tip may be off where something was marked."""

from __future__ import annotations

import math
from typing import Any

import pytest

from imud.params.value import Params
from imud.probes.mark import KEPT_MAX, MarkBook, mark_of
from imud.published import SinceOrigin

POSE: dict[str, Any] = {
    "number": 7,
    "t_device_us": 5_000_000,
    "t_ns": 1_800_000_000_000_000_000,
    "q": (1.0, 0.0, 0.0, 0.0),
    "position_m": (0.1, 0.0, 0.02),
    "normal": (0.0, 0.0, 1.0),
    "tilt_sigma_deg": 0.4,
    "heading_sigma_deg": 3.0,
    "flags": (),
    "since_origin": None,
}
TIP = Params().replaced("tip", {"offset_m": (0.1, 0.0, 0.0), "sigma_m": 0.001}).encode()

NOTED = {"value": 0.42, "unit": "N", "text": "second press"}


def test_the_errors_of_tip_attitude_and_strokes_add_up() -> None:
    found = mark_of(POSE, TIP, [0.002, 0.003, 0.001], NOTED)
    turned = 0.1 * math.radians(math.hypot(0.4, 3.0))
    assert found["position_sigma_m"] == pytest.approx(
        math.sqrt(0.001**2 + turned**2 + 0.003**2), rel=1e-3
    )
    assert found["no_position"] is None
    assert {key: found[key] for key in NOTED} == NOTED
    assert found["t_pose_ns"] == POSE["t_ns"]
    assert found["number"] == 7


def test_errors_since_the_origin_go_before_those_in_the_world() -> None:
    since = SinceOrigin(0.2, 0.1, 5.0)
    found = mark_of(POSE | {"since_origin": since}, TIP, [], NOTED)
    assert (found["tilt_sigma_deg"], found["heading_sigma_deg"]) == (0.1, 0.2)
    assert found["position_sigma_m"] < 0.0011
    void = SinceOrigin(0.2, 0.1, 5.0, "gap")
    found = mark_of(POSE | {"since_origin": void}, TIP, [], NOTED)
    assert found["heading_sigma_deg"] == 3.0


@pytest.mark.parametrize(
    ("pose", "params"),
    [
        (POSE | {"position_m": None}, TIP),
        (POSE | {"heading_sigma_deg": None}, TIP),
        (POSE, None),
        (POSE, b""),
        ({}, TIP),
    ],
)
def test_what_is_not_known_is_not_stated(
    pose: dict[str, Any], params: bytes | None
) -> None:
    found = mark_of(pose, params, [], {"text": "a note"})
    assert found["position_sigma_m"] is None
    assert found["text"] == "a note"
    if not pose:
        assert found["q"] is None
        assert found["flags"] is None


@pytest.mark.parametrize(
    ("pose", "params", "why"),
    [
        ({}, TIP, "no pose at this moment; start the stream"),
        (POSE | {"position_m": None}, b"", "calibrate the tip"),
        (POSE | {"position_m": None}, TIP, "it has no origin; set one"),
        (POSE | {"position_m": None, "flags": ("tared",)}, TIP, "a stroke since"),
    ],
)
def test_a_mark_says_why_it_has_no_position(
    pose: dict[str, Any], params: bytes, why: str
) -> None:
    assert why in mark_of(pose, params, [], NOTED)["no_position"]


def test_a_book_has_marks_as_they_are_now_and_no_end_of_them() -> None:
    book = MarkBook()
    for number in range(KEPT_MAX + 2):
        about = {"probe_id": "a", "id": f"{number:03}", "state": "new"}
        book.take({**about, "value": number})
    book.take({"probe_id": "a", "id": "007", "state": "corrected", "value": -1})
    book.take({"probe_id": "a", "id": "008", "state": "withdrawn", "value": 8})
    found = [mark["value"] for mark in book.of("a")]
    assert found == [2, 3, 4, 5, 6, -1, *range(9, KEPT_MAX + 2)]
    assert book.of("b") == []
