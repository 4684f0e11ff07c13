# SPDX-License-Identifier: MIT
"""A path of strokes that has returned to its origin, as `imud strokes` closes it."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable
from typing import Any, cast

import pytest

from imud.cli import stroke_lines
from imud.cli.stroke_path import lines_of, object_of
from imud.client import Client
from imud.probes.path import Path

SIGMA = [0.004, 0.004, 0.003]
WAYS = [
    (0.3, 0.0, 0.001),
    (0.001, 0.2, 0.0),
    (-0.299, 0.0, 0.0),
    (0.002, -0.196, 0.003),
]


def strokes(ways: list[Any] | None = None) -> list[dict[str, Any]]:
    """Strokes as published, from an origin on."""
    told, place = [], (0.0, 0.0, 0.0)
    for number, way in enumerate(ways or WAYS, 1):
        place = tuple(a + b for a, b in zip(place, way, strict=True))
        told.append(
            {
                "type": "stroke",
                "stroke": number,
                "windows": 10,
                "end": "button",
                "displacement_m": list(way),
                "displacement_sigma_m": SIGMA,
                "path_m": list(place),
                "path_sigma_m": SIGMA,
                "t_device_us": 1_000_000 * number,
            }
        )
    return told


def path_of(*told: dict[str, Any]) -> Path:
    path = Path()
    for stroke in told:
        path.take_stroke(stroke)
    return path


def test_what_a_path_is_off_is_spread_evenly_over_its_strokes() -> None:
    path = path_of(*strokes())
    assert path.places[-1] == pytest.approx([0.004, 0.004, 0.004])
    assert path.closed() == [
        pytest.approx([0.299, -0.001, 0.0]),
        pytest.approx([0.299, 0.198, -0.001]),
        pytest.approx([-0.001, 0.197, -0.002]),
        pytest.approx([0.0, 0.0, 0.0]),
    ]


def test_what_runs_is_no_part_of_a_path() -> None:
    told = strokes()
    running = told[1] | {"end": "running", "displacement_m": [9.0, 9.0, 9.0]}
    assert path_of(told[0], running, *told[1:]).places == path_of(*told).places


def test_a_stroke_without_length_ends_a_path() -> None:
    told = strokes()
    lost = told[1] | {"end": "clipped", "displacement_m": None, "path_m": None}
    assert path_of(told[0], lost).places == []
    assert path_of(told[0], lost, told[0]).places == [told[0]["path_m"]]


def test_a_new_origin_begins_a_path_anew() -> None:
    told = strokes()
    assert path_of(*told[:3], *told[:2]).places == [each["path_m"] for each in told[:2]]


def test_the_first_pose_after_a_stroke_tells_where_the_tip_is() -> None:
    path = path_of(strokes()[0])
    path.take_pose({"t_device_us": 999_999, "position_m": [7.0, 7.0, 7.0]})
    path.take_pose({"t_device_us": 1_000_000, "position_m": [0.31, 0.0, 0.0]})
    path.take_pose({"t_device_us": 1_010_000, "position_m": [8.0, 8.0, 8.0]})
    assert path.places == [[0.31, 0.0, 0.0]]
    path.take_stroke(strokes()[1])
    path.take_pose({"t_device_us": 2_000_000, "position_m": None})
    assert path.places[-1] == strokes()[1]["path_m"]


@pytest.mark.parametrize(("off", "word"), [(0.004, "within"), (0.009, "more than")])
def test_how_far_it_is_off_is_told_beside_what_is_stated(off: float, word: str) -> None:
    path = path_of(*strokes([(0.1, 0.0, 0.0), (off - 0.1, 0.0, 0.0)]))
    head, end, stated, _, *rows = lines_of("stylus", path)
    assert head == f"stylus: 2 strokes end {100 * off:.2f} cm from their origin:"
    assert word in end
    assert stated.split() == ["0.78", "0.78", "0.59", "(95", "%)"]
    assert [float(each) for each in rows[0].split()[:5]] == pytest.approx(
        [1, 10.0, 0.0, 0.0, 10.0 - 50 * off], abs=0.01
    )
    assert object_of("stylus", path)["off_m"] == pytest.approx([off, 0.0, 0.0])


class Heard(deque[bytes]):
    """A queue whose user presses Ctrl-C when it is empty."""

    put = deque.append

    def get(self, **_: float) -> bytes:
        if not self:
            raise KeyboardInterrupt
        return self.popleft()


class Network:
    """A client that hears these messages as soon as it subscribes."""

    def __init__(self, told: list[dict[str, Any]]) -> None:
        self.told = told

    def subscribe(
        self, topic: str, _: str | None, callback: Callable[[str, bytes], None]
    ) -> Callable[[], None]:
        for each in self.told:
            if each["type"] == topic:
                callback(each["probe"], json.dumps(each).encode())
        return lambda: None


def closed(told: list[dict[str, Any]], *, as_json: bool) -> None:
    network = cast(Client, Network([{"probe": "stylus"} | each for each in told]))
    stroke_lines.listen(network, None, None, as_json=as_json, closes=True)


@pytest.fixture(autouse=True)
def heard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stroke_lines.queue, "SimpleQueue", Heard)


@pytest.mark.parametrize("as_json", [False, True])
def test_a_path_is_closed_when_ctrl_c_ends_it(
    capsys: pytest.CaptureFixture[str], as_json: bool
) -> None:
    pose = {"type": "pose", "t_device_us": 4_000_000, "position_m": [0.005, 0.0, 0.0]}
    closed([*strokes(), pose], as_json=as_json)
    said = capsys.readouterr().out.splitlines()
    if as_json:
        assert json.loads(said[-1])["off_m"] == [0.005, 0.0, 0.0]
        assert json.loads(said[-1])["closed_m"][-1] == [0.0, 0.0, 0.0]
        assert len(said) == len(WAYS) + 1
    else:
        assert "stylus: 4 strokes end 0.50 cm from their origin:" in said


def test_without_an_origin_there_is_nothing_to_close(
    capsys: pytest.CaptureFixture[str],
) -> None:
    closed([each | {"path_m": None} for each in strokes()], as_json=False)
    assert "imud tare" in capsys.readouterr().err
