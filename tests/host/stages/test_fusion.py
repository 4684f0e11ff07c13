# SPDX-License-Identifier: MIT
"""Fusion on the host: the poses and strokes of a probe that sends only raw samples are
those that it would have sent. A Nano, which has no room for strokes, gets them here."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from core.desk import lib
from core.stroke_desk import Measured, measured
from fakes.records import calibrated_records, record
from imud.config.reader import load
from imud.config.settings import Config, ProbeSettings
from imud.errors import ConfigError
from imud.params.value import SENSORS, Params
from imud.probes.session import Received
from imud.stages import InjectMessage, SendCommands, StageResult
from imud.stages.fusion import FusionStage, with_strokes
from imud.virtual.stroking import Plan
from imud.wire.messages import encode
from sessions import received
from stroke_bench import TIP, feel, stroking
from twin_bench import (
    PERIOD_US,
    Life,
    changed,
    followed,
    message_of,
    named,
    without,
)

TIME_ON = slice(5, None)  # of content: all but id and number
STROKE, TELL = (
    record(5, bytes((does, lib.REFERENCE_NONE)))
    for does in (lib.BUTTON_DOES_STROKE, lib.BUTTON_DOES_TELL)
)


def stage_of(event: Received, *, is_on: bool = True) -> FusionStage:
    settings = ProbeSettings(fuse_on_host=is_on)
    return FusionStage(Config(probes={event.probe_id: settings}))


def fused(contents: list[bytes], *, is_on: bool = True) -> list[StageResult]:
    """The stage's answers to these messages."""
    events = received(contents)
    stage = stage_of(events[0], is_on=is_on)
    return [outcome for event in events for outcome in stage.on_message(event)]


def added(outcomes: list[StageResult], name: str = "pose") -> list[bytes]:
    contents = [each.content for each in outcomes if isinstance(each, InjectMessage)]
    return [each for each in contents if message_of(each).name == name]


def own_poses(contents: list[bytes]) -> list[bytes]:
    return [contents[at] for at in named(contents, "pose")]


def tail(contents: list[bytes]) -> list[bytes]:
    return [content[TIME_ON] for content in contents]


def test_its_poses_are_in_every_bit_those_of_the_probe() -> None:
    life = followed().live(620)
    for change in (
        lambda: life.order(lib.COMMAND_TARE, 0),
        lambda: life.miss(2),
        lambda: life.live(1, gyr_clipped=True),
        lambda: life.order(lib.COMMAND_RESTART),
        lambda: life.order(lib.COMMAND_TARE, 1),
        lambda: life.order(lib.COMMAND_RESTART, lib.FILTER_MAHONY),
    ):
        change()
        life.live(150)
    here = added(fused(life.contents))
    assert len(here) > 700
    assert tail(here) == tail(own_poses(life.contents))


@pytest.mark.parametrize("is_by_button", [False, True])
def test_its_strokes_are_in_every_bit_those_of_the_probe(is_by_button: bool) -> None:
    life, scene = stroking() if is_by_button else (followed(), stroking()[1])
    feel(life, scene.samples, scene.held() & is_by_button)
    here = fused(life.contents)
    theirs = [life.contents[at] for at in named(life.contents, "stroke")]
    ends = {message_of(each).fields["end"] for each in theirs}
    assert ends == {"running", "button" if is_by_button else "rest"}
    assert tail(added(here, "stroke")) == tail(theirs)
    assert tail(added(here)) == tail(own_poses(life.contents))


@pytest.mark.parametrize(
    "about",
    [
        {"board": "micropython", "self_test": (), "filter": "madgwick"},
        {"filter": "none"},
    ],
)
def test_a_board_without_our_filter_gets_it(about: dict[str, object]) -> None:
    life = followed().live(620)
    contents = [
        changed(content, **about) if message_of(content).name == "hello" else content
        for content in life.contents
    ]
    assert tail(added(fused(contents))) == tail(own_poses(life.contents))


def test_a_sample_after_a_loss_says_so_in_the_next_pose() -> None:
    life = followed().live(620)
    raws = named(life.contents, "raw")
    outcomes = fused(without(life.contents, *raws[500:504]))
    poses = [message_of(content) for content in added(outcomes)]
    gaps = [pose for pose in poses if "gap" in pose.fields["pose_flags"]]
    lost_us = message_of(life.contents[raws[503]]).time_us
    assert [lost_us < pose.time_us <= lost_us + 10_000 for pose in gaps] == [True]


def by(method: str, seed: int) -> bytes:
    """Params of three sensors that were calibrated by this method; the gyroscope's bias
    is always the same.
    """
    params = Params.decode(calibrated_records(seed))
    for name in SENSORS:
        plain = (params.plain(name) or {}) | {"method": method}
        if name == "gyr":
            plain["bias_counts"] = [1.0, 2.0, 3.0]
        params = params.replaced(name, plain)
    return params.encode()


@pytest.mark.parametrize(
    ("method", "goes_on"), [("learned", True), ("learned", False), ("wave", False)]
)
def test_its_poses_are_those_of_the_probe_through_a_change_of_params(
    method: str, goes_on: bool
) -> None:
    life = followed().load(by("wave", 1)).live(620)
    life.load(by(method, 2), goes_on=goes_on).live(300)
    here = tail(added(fused(life.contents)))
    assert here == tail(own_poses(life.contents))


@pytest.mark.parametrize("method", ["learned", "wave"])
def test_it_begins_anew_by_itself_but_for_what_was_learned(method: str) -> None:
    life = followed().load(by("wave", 1)).live(1000)
    life.load(by(method, 2), goes_on=True).live(60)
    at = named(life.contents, "params_changed")[-1]
    change_us = message_of(life.contents[at]).time_us
    before, after = set(), set()
    for each in added(fused(life.contents)):
        pose = message_of(each)
        if abs(pose.time_us - change_us) < 200_000:
            known = after if pose.time_us > change_us else before
            known.add("starting" in pose.fields["pose_flags"])
    assert before == {False}
    assert after == {method != "learned"}


def test_it_asks_once_for_all_samples_and_no_poses() -> None:
    life = followed(raw_hz=50).live(400)
    outcomes = fused(life.contents)
    (wants,) = [each for each in outcomes if isinstance(each, SendCommands)]
    assert wants.commands == (
        ("rate", {"stream": "raw", "hz": "200"}),
        ("fields", {"streams": "raw"}),
    )


def test_the_rate_of_poses_is_the_probes() -> None:
    life = Life().order(lib.COMMAND_FIELDS, lib.STREAM_RAW)
    life.order(lib.COMMAND_RATE, 0, 25).order(lib.COMMAND_START).wake().live(800)
    outcomes = fused(life.contents)
    times = [message_of(content).time_us for content in added(outcomes)]
    assert {b - a for a, b in itertools.pairwise(times)} == {40_000}


def test_it_is_off_by_default() -> None:
    assert fused(followed().live(300).contents, is_on=False) == []


@pytest.mark.parametrize("line", ['streams = ["pose"]', "raw_rate = 100"])
def test_what_contradicts_it_is_named(tmp_path: Path, line: str) -> None:
    file = tmp_path / "imud.toml"
    file.write_text(f"[probes.00112233445566aa]\nfuse_on_host = true\n{line}\n")
    with pytest.raises(ConfigError, match="is set by fuse_on_host"):
        load(file)


# Strokes.


@pytest.fixture(scope="module")
def scene() -> Measured:
    return measured(Plan(strokes=2), 7)


def contents_in(
    scene: Measured, records: bytes, *, presses: bool = True
) -> list[bytes]:
    """The messages of a probe with these params in a scene."""
    life: Life = followed().load(records)
    held = scene.held() & presses
    for number, (row, is_held) in enumerate(zip(scene.samples, held, strict=True)):
        if number == 1700:  # at rest, before the first stroke
            life.order(lib.COMMAND_TARE, 1)
        life.now_us += PERIOD_US
        life.sample(row)
        lib.probe_step(life.c, bool(is_held), life.time_us)
    return life.contents


def as_nano(contents: list[bytes]) -> list[bytes]:
    """The same from a Nano: no strokes, and another board in its hellos."""
    decoded = [message_of(content) for content in contents]
    return [
        encode(
            each.name,
            dict(each.fields) | ({"board": "nano"} if each.name == "hello" else {}),
            number,
            each.time_us,
        )
        for number, each in enumerate(each for each in decoded if each.name != "stroke")
    ]


@pytest.mark.parametrize(
    ("records", "presses", "end"), [(TELL, True, "button"), (b"", False, "rest")]
)
def test_a_nano_has_strokes_and_places(
    scene: Measured, records: bytes, presses: bool, end: str
) -> None:
    outcomes = fused(as_nano(contents_in(scene, TIP + records, presses=presses)))
    strokes = [message_of(each).fields for each in added(outcomes, "stroke")]
    ended = [each for each in strokes if each["end"] != "running"]
    assert [each["end"] for each in ended] == [end, end]
    for stroke, true in zip(ended, scene.strokes, strict=True):
        length = np.linalg.norm(np.array(stroke["displacement"], float))
        assert length == pytest.approx(np.linalg.norm(true.way_m), abs=0.008)
    last = message_of(added(outcomes)[-1]).fields
    assert last["position"] is not None
    assert last["normal"] is not None


def test_poses_of_a_nano_are_its_own_but_for_the_place(scene: Measured) -> None:
    contents = as_nano(contents_in(scene, TELL))
    own = tail([contents[at] for at in named(contents, "pose")])
    # Without a tip a place is nobody's.
    assert tail(added(fused(contents)))[: len(own) // 3] == own[: len(own) // 3]


def test_what_its_button_does_besides_is_left_alone() -> None:
    for records in (b"", TIP, TIP + STROKE):
        assert with_strokes(records) == records
    params = Params.decode(with_strokes(TIP + TELL))
    assert params.options.button_does == "stroke"
    assert params.tip == Params.decode(TIP).tip
