# SPDX-License-Identifier: MIT
"""What `imud listen` prints, in which angles, and what it calls missing."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from fakes import FakeProbe
from imud import rotation
from imud.cli import watch
from imud.cli.pose_table import PIPE_S, TERMINAL_S, PoseTable, Reception, json_line

POSE: dict[str, Any] = {
    "q": [1.0, 0.0, 0.0, 0.0],
    "tilt_sigma_deg": 0.375,
    "heading_sigma_deg": None,
    "flags": ["at_rest", "heading_free"],
}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def received(**pose: Any) -> Reception:
    one = Reception()
    for number in range(101):
        one.on_pose(json.dumps(POSE | pose).encode(), number * 0.01)
    return one


def test_a_terminal_is_drawn_over_in_place() -> None:
    out = Terminal()
    table = PoseTable(out)
    assert table.period_s == TERMINAL_S
    table.draw({"p": received()}, 1.0)
    first = out.getvalue()
    table.draw({"p": received()}, 1.0)
    assert out.getvalue() == first + "\x1b[2F" + first
    assert first.count("\n") == 2


def test_a_line_ends_with_the_errors_since_the_origin() -> None:
    since = {"heading_sigma_deg": 0.12, "tilt_sigma_deg": 0.05, "age_s": 60.0}
    for found, words in (
        (since | {"void": None}, "tared  since origin ±0.05 ±0.12"),
        (since | {"void": "gap"}, "tared  since origin ? (samples are missing)"),
        (None, "tared"),
    ):
        out = io.StringIO()
        told = received(since_origin=found, flags=["tared"])
        PoseTable(out).draw({"p": told}, 1.0)
        assert out.getvalue().splitlines()[1].endswith(f"Hz  {words}")


def test_a_pipe_gets_plain_lines_under_one_heading() -> None:
    out = io.StringIO()
    table = PoseTable(out)
    assert table.period_s == PIPE_S
    table.draw({}, 0.0)
    assert out.getvalue() == ""
    for _ in range(2):
        table.draw({"p": received()}, 1.0)
    lines = out.getvalue().splitlines()
    assert "\x1b" not in out.getvalue()
    assert len(lines) == 3
    assert lines[1].split() == [
        *("p", "0.00", "0.00", "0.00", "±0.38", "?", "100", "Hz"),
        *("at_rest", "heading_free"),
    ]


def test_the_rate_is_that_of_the_last_second() -> None:
    one = received()
    assert one.mean_hz == pytest.approx(100.0)
    assert one.rate_hz(1.5) == 50
    assert one.rate_hz(9.0) == 0


def test_missing_numbers_are_counted_and_a_restart_is_none() -> None:
    one, probe = Reception(), FakeProbe()
    contents = [probe.content("pose") for _ in range(10)]
    for content in contents[:3] + contents[5:]:
        one.on_frame(content)
    assert one.missing == 2
    probe.restart()
    for _ in range(3):
        one.on_frame(probe.content("pose"))
    assert one.missing == 2


HALF = 0.5**0.5
# x to the north and 60 degrees down: docs/pose-details.md has its angles.
DIVE = (0.75**0.5 * HALF, -0.5 * HALF, 0.5 * HALF, 0.75**0.5 * HALF)


def printed(shape: Any, out: io.StringIO) -> list[str]:
    PoseTable(out, shape).draw({"p": received(q=DIVE)}, 1.0)
    return out.getvalue().splitlines()


@pytest.mark.parametrize(
    ("shape", "angles"),
    [
        (None, [90, 60, 0]),
        ("nautical", [90, 60, 0]),
        ("aerospace", [0, -60, 0]),
        ("nectec", [0, 60, 90]),
    ],
)
def test_angles_are_those_of_the_chosen_convention(
    shape: Any, angles: list[float]
) -> None:
    head, line = printed(shape, io.StringIO())
    assert [float(word) for word in line.split()[1:4]] == angles
    if shape is None:
        assert head.split()[:5] == ["probe", "yaw", "pitch", "roll", "tilt"]
    else:
        assert head.split()[1:8] == [shape, "yaw", "°", "pitch", "°", "roll", "°"]
    assert head.index("tilt") + len("tilt") == line.index("±0.38") + len("±0.38")


def test_a_matrix_is_three_rows_along_east_north_and_up() -> None:
    head, *rows = printed("matrix", io.StringIO())
    assert head.split()[:6] == ["probe", "matrix", "world", "x", "y", "z"]
    assert len(head) <= 80
    words = [row[16:].split()[:4] for row in rows]
    assert [axis for axis, *_ in words] == ["east", "north", "up"]
    assert [[float(word) for word in row] for _, *row in words] == [
        [0, -1, 0],
        [0.5, 0, 0.866],
        [-0.866, 0, 0.5],
    ]
    assert rows[0].startswith("p ")
    assert rows[0].endswith("at_rest heading_free")


def test_a_terminal_draws_over_all_rows_of_a_matrix() -> None:
    out = Terminal()
    table = PoseTable(out, "matrix")
    for _ in range(2):
        table.draw({"p": received(), "q": received()}, 1.0)
    assert out.getvalue().count("\x1b[7F") == 1


def test_json_gets_an_object_named_by_the_convention() -> None:
    payload = json.dumps(POSE | {"q": DIVE}).encode()
    assert json_line(payload, None) == payload.decode()
    for shape in ("aerospace", "nautical", "nectec"):
        pose = json.loads(json_line(payload, shape))
        angles = pose.pop(shape)
        assert pose == json.loads(payload)
        assert angles == rotation.angles_deg(DIVE, shape)._asdict()
        assert list(angles) == ["yaw_deg", "pitch_deg", "roll_deg"]
    matrix = json.loads(json_line(payload, "matrix"))["matrix"]
    assert matrix == [list(row) for row in rotation.matrix_rows(DIVE)]


def test_the_command_line_knows_each_convention() -> None:
    assert set(watch.ANGLES) == {*rotation.CONVERSIONS, "matrix"}
