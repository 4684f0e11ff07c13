# SPDX-License-Identifier: MIT
"""`imud strokes`: strokes as they end, and a path of them that has returned to its
origin.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
from collections import deque
from collections.abc import Callable
from typing import IO, Any, cast

import jsonschema
import numpy as np
import pytest

from chain import Chain
from fakes import EXAMPLES, Forked
from imud.cli import stroke_lines
from imud.cli.stroke_lines import line_of, lines_of
from imud.client import Client, Delivery
from imud.errors import CommandRefused
from imud.log.schemas import JSON_SCHEMAS
from imud.params.trusted import CALIBRATED
from imud.probes.gestures import PathCloser
from imud.probes.path import StrokePath, scale_sigma
from imud.probes.withheld import STROKE_ADVICE
from imud.wire.messages import Message, decode, encode
from imud.wire.schema import StrokeEnd
from streaming import Streaming

STROKE = {
    "probe": "stylus",
    "stroke": 3,
    "windows": 14,
    "displacement_m": [0.03, -0.04, 0.0],
    "displacement_sigma_m": [0.0021, 0.0021, 0.0018],
    "end": "button",
}


def test_a_stroke_is_a_line_with_its_length_and_errors() -> None:
    assert line_of(STROKE).split() == [
        *("stylus", "3", "1.4", "s", "5.00", "cm", "3.00", "-4.00", "0.00"),
        *("0.21", "0.21", "0.18", "button"),
    ]


def test_a_stroke_without_length_says_why() -> None:
    lost = STROKE | {"displacement_m": None, "end": "too_long"}
    assert line_of(lost).split() == ["stylus", "3", "1.4", "s", "unknown", "too_long"]
    for end in StrokeEnd:
        content = encode("stroke", EXAMPLES["stroke"] | {"end": end.name.lower()}, 1, 2)
        told = decode(content)
        assert isinstance(told, Message)
        advice = STROKE_ADVICE.get(str(told.fields["end"]))
        assert (advice is None) == (end in (0, 1, 2))
    lost |= {"end": "no_rest", "advice": "lay it still first"}
    assert line_of(lost).endswith("  no_rest: lay it still first")


def test_a_path_that_the_daemon_does_not_close_is_told_and_an_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def press_ctrl_c(_: str) -> None:
        raise KeyboardInterrupt

    ended = json.dumps(STROKE | {"type": "stroke"}).encode()

    class Refusing:
        def listen(
            self, kind: str, _: str | None, put: Callable[[Delivery], None]
        ) -> Callable[[], None]:
            if kind == "stroke":
                put(Delivery("stylus", ended, "source"))
            return lambda: None

        def command(self, probe: str, name: str) -> dict[str, Any]:
            raise CommandRefused(f"{probe} has no {name}")

    monkeypatch.setattr(stroke_lines, "show", press_ctrl_c)  # at the first stroke
    client = cast(Client, Refusing())
    assert stroke_lines.listen(client, None, None, as_json=True, closes=True) == 1
    assert capsys.readouterr().err == "stylus has no close\n"


@pytest.mark.parametrize("words", [[], ["--json"]])
def test_strokes_are_printed_as_they_end(chain: Chain, words: list[str]) -> None:
    words = [*words, "--connect", chain.daemon.endpoint]
    say = chain.probe.say

    def said() -> bytes:
        """Again and again: nobody knows when the subscription has arrived."""
        return say("stroke", end="running") + say("stroke", stroke=7)

    with Forked("-m", "imud", "strokes", *words, stdout=subprocess.PIPE) as program:
        with Streaming(chain.port, chain.probe, 0.05, said):
            out = cast(IO[str], program.stdout)
            lines = [out.readline() for _ in range(2)]
        program.terminate()
    if "--json" in words:
        assert [json.loads(line)["stroke"] for line in lines] == [7, 7]
    else:
        assert lines[0].startswith("probe")
        assert lines[1].split()[:2] == [chain.probe.name, "7"]


SIGMA = [0.004, 0.004, 0.003]
WAYS = [
    (0.3, 0.0, 0.001),
    (0.001, 0.2, 0.0),
    (-0.299, 0.0, 0.0),
    (0.002, -0.196, 0.003),
]


def strokes(ways: list[Any] | None = None) -> list[dict[str, Any]]:
    """Strokes as published, from an origin on."""
    records, place = [], (0.0, 0.0, 0.0)
    for number, way in enumerate(ways or WAYS, 1):
        place = tuple(a + b for a, b in zip(place, way, strict=True))
        records.append(
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
    return records


def path_of(*records: dict[str, Any]) -> StrokePath:
    path = StrokePath()
    for stroke in records:
        path.add_stroke(stroke)
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
    records = strokes()
    running = records[1] | {"end": "running", "displacement_m": [9.0, 9.0, 9.0]}
    assert path_of(records[0], running, *records[1:]).places == path_of(*records).places


def test_a_stroke_without_length_ends_a_path() -> None:
    records = strokes()
    lost = records[1] | {"end": "clipped", "displacement_m": None, "path_m": None}
    assert path_of(records[0], lost).places == []
    assert path_of(records[0], lost, records[0]).places == [records[0]["path_m"]]


def test_a_new_origin_begins_a_path_anew() -> None:
    records = strokes()
    assert path_of(*records[:3], *records[:2]).places == [
        each["path_m"] for each in records[:2]
    ]


def test_the_first_pose_after_a_stroke_tells_where_the_tip_is() -> None:
    path = path_of(strokes()[0])
    path.add_pose({"t_device_us": 999_999, "position_m": [7.0, 7.0, 7.0]})
    path.add_pose({"t_device_us": 1_000_000, "position_m": [0.31, 0.0, 0.0]})
    path.add_pose({"t_device_us": 1_010_000, "position_m": [8.0, 8.0, 8.0]})
    assert path.places == [[0.31, 0.0, 0.0]]
    path.add_stroke(strokes()[1])
    path.add_pose({"t_device_us": 2_000_000, "position_m": None})
    assert path.places[-1] == strokes()[1]["path_m"]


@pytest.mark.parametrize(("off", "word"), [(0.004, "within"), (0.009, "more than")])
def test_how_far_it_is_off_is_told_beside_what_is_stated(off: float, word: str) -> None:
    path = path_of(*strokes([(0.1, 0.0, 0.0), (off - 0.1, 0.0, 0.0)]))
    closing = path.closing(0.001, 0.001)
    assert closing is not None
    head, end, stated, _, *rows = lines_of("stylus", closing)
    assert head == f"stylus: 2 strokes end {100 * off:.2f} cm from their origin:"
    assert word in end
    assert stated.split() == ["0.81", "0.81", "0.62", "(95", "%)"]
    assert [float(each) for each in rows[0].split()[:5]] == pytest.approx(
        [1, 10.0, 0.0, 0.0, 10.0 - 50 * off], abs=0.01
    )
    assert closing["off_m"] == pytest.approx([off, 0.0, 0.0])


def test_there_and_back_halves_the_error_of_both_strokes_but_not_the_scale() -> None:
    path = path_of(*strokes([(0.1, 0.0, 0.0), (-0.1, 0.0, 0.0)]))
    closing = path.closing(0.01, 0.002)
    assert closing is not None
    square = (2 * np.array(SIGMA) ** 2 + 0.002**2) / 4 + 0.001**2
    assert closing["closed_sigma_m"][0] == pytest.approx(square**0.5)
    assert closing["closed_sigma_m"][1] == pytest.approx([0.002] * 3)
    raw = scale_sigma(None)
    assert (raw, scale_sigma(CALIBRATED)) == pytest.approx((0.0204, 0.00071), rel=0.01)


def test_a_path_that_has_not_returned_is_not_closed() -> None:
    path = path_of(*strokes([(0.1, 0.0, 0.0), (-0.08, 0.0, 0.0)]))
    closing = path.closing(0.001, 0.001)
    assert closing is not None
    assert (closing["closed_m"], closing["closed_sigma_m"]) == (None, None)
    *_, head, first, last = lines_of("stylus", closing)
    assert head.endswith("not closed: it did not return, or a stroke is wrong")
    assert (first.split()[:2], last.split()[:2]) == (["1", "10.00"], ["2", "2.00"])


KNOWN = (0.001, 0.001)  # scale, a share, and return, m
TARED = {"type": "event", "event": "tared", "t_device_us": 5_150_000}
PRESS = {"type": "event", "event": "button_pressed", "t_device_us": 5_000_000}


def test_a_double_click_closes_the_path_of_before_it() -> None:
    closer = PathCloser()
    for each in (*strokes(), PRESS, TARED, PRESS):
        closer.on_record(each)  # its first click has started the stream
    found = closer.closing(*KNOWN, is_double=True)
    assert found == path_of(*strokes()).closing(*KNOWN)
    assert closer.closing(*KNOWN) is None
    closer.on_record(PRESS)
    assert closer.closing(*KNOWN, is_double=True) is None


def test_a_path_is_closed_by_command_and_by_its_button(chain: Chain) -> None:
    heard = chain.hear("path")
    client, name = chain.client, chain.probe.name
    with pytest.raises(CommandRefused, match="no path to close"):
        client.command(name, "close")
    path = {"path": (0.1, 0.0, 0.0), "path_sigma": (0.04, 0.05)}
    chain.port.write(chain.probe.say("stroke", **path))
    while True:  # until the stroke has arrived
        with contextlib.suppress(CommandRefused):
            value = client.command(name, "close")["value"]
            break
    records = [json.loads(heard.get())]
    for event in 2 * ("button_pressed", "button_released"):
        chain.port.write(chain.probe.say("event", event=event))
    records.append(json.loads(heard.get()))
    for each, by in zip(records, ("command", "button"), strict=True):
        jsonschema.validate(each, JSON_SCHEMAS["path"])
        assert (each["type"], each["probe"], each["by"]) == ("path", name, by)
        assert each["off_m"] == pytest.approx([0.1, 0.0, 0.0])
        assert each["off_sigma_m"] == pytest.approx([0.04, 0.04, 0.05], rel=1e-3)
        assert not each["is_explained"]
        assert each["closed_m"] == [[0.0, 0.0, 0.0]]
        assert {key: each[key] for key in value} == value


class Heard(deque[Delivery]):
    """A queue whose user presses Ctrl-C when it is empty."""

    put = deque.append

    def get(self, **_: float) -> Delivery:
        if not self:
            raise KeyboardInterrupt
        return self.popleft()


class Network:
    """A client that hears these messages as soon as it listens."""

    def __init__(self, records: list[dict[str, Any]]) -> None:
        self.records = records

    def listen(
        self, topic: str, _: str | None, callback: Callable[[Delivery], None]
    ) -> Callable[[], None]:
        for each in self.records:
            if each["type"] == topic:
                payload = json.dumps(each).encode()
                callback(Delivery(each["probe"], payload, "", "00112233445566aa"))
        return lambda: None

    def command(self, probe: str, name: str) -> dict[str, Any]:
        """Closes the path of all, as the daemon does."""
        closer = PathCloser()
        for each in self.records:
            closer.on_record(each)
        closing = closer.closing(*KNOWN)
        if closing is None:
            raise CommandRefused(f"{probe}: {name}: there is no path to close")
        return {"value": closing}


def closed(records: list[dict[str, Any]], *, as_json: bool) -> None:
    """Of a probe that is renamed before the last two."""
    made = [{"probe": "point"} | each for each in records[:-2]]
    made += [{"probe": "stylus"} | each for each in records[-2:]]
    network = cast(Client, Network(made))
    stroke_lines.listen(network, None, None, as_json=as_json, closes=True)


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stroke_lines.queue, "SimpleQueue", Heard)


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("by_button", [False, True])
def test_a_path_is_closed_by_its_button_and_when_ctrl_c_ends_it(
    capsys: pytest.CaptureFixture[str], as_json: bool, by_button: bool
) -> None:
    closing = path_of(*strokes()).closing(*KNOWN)
    pose = {"type": "pose", "t_device_us": 4_000_000, "position_m": [0.005, 0.0, 0.0]}
    told = [{"type": "path", **(closing or {})}] if by_button else [*strokes(), pose]
    closed(told, as_json=as_json)
    lines = capsys.readouterr().out.splitlines()
    if as_json:
        off = [0.004, 0.004, 0.004] if by_button else [0.005, 0.0, 0.0]
        assert json.loads(lines[-1])["off_m"] == pytest.approx(off)
        assert json.loads(lines[-1])["closed_m"][-1] == [0.0, 0.0, 0.0]
        assert len(lines) == (1 if by_button else len(WAYS) + 1)
    else:
        off_cm = "0.69" if by_button else "0.50"
        assert f"stylus: 4 strokes end {off_cm} cm from their origin:" in lines


@pytest.mark.usefixtures("at_once")
def test_without_an_origin_there_is_nothing_to_close(
    capsys: pytest.CaptureFixture[str],
) -> None:
    closed([each | {"path_m": None} for each in strokes()], as_json=False)
    assert "no path to close" in capsys.readouterr().err
