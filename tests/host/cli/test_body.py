# SPDX-License-Identifier: MIT
"""`imud body`: a body from the poses of several probes, published, logged, printed."""

from __future__ import annotations

import contextlib
import json
import math
import re
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh
from mcap.reader import make_reader

from fakes import Forked
from fakes.daemon import free_endpoint
from imud import cli
from imud.body import chain
from imud.body.live import LiveBody
from imud.body.state import BodyState
from imud.cli.body_run import Printer, add_delivery, joint_topic, line_of, messages
from imud.client import Delivery
from imud.config.settings import ZenohSettings
from imud.net import network
from imud.sinks.ros2 import TF
from imud.virtual import leg
from streaming import until

DOCUMENT = Path(__file__).parents[3] / "docs" / "limb.md"
ENDED_S = 60.0  # only a hang takes longer


def pose_of(probe: str, number: int, **other: object) -> bytes:
    """A pose of a probe at rest, as a daemon publishes it, of this moment."""
    values = {
        "type": "pose",
        "probe": probe,
        "seq": number,
        "number": number,
        "missing": 0,
        "t_device_us": number * 10_000,
        "t_ns": time.time_ns(),
        "t_bound_us": 600,
        "age_us": 0,
        "q": [1.0, 0.0, 0.0, 0.0],
        "position_m": None,
        "normal": None,
        "tilt_sigma_deg": 0.5,
        "heading_sigma_deg": 2.0,
        "flags": [],
    }
    return json.dumps(values | other).encode()


class Probes:
    """Still probes of daemons, one or more a daemon, 50 poses a second."""

    def __init__(self, by_endpoint: dict[str, list[str]]) -> None:
        self.silent: set[str] = set()
        self.sessions = {
            each: network.open_daemon(ZenohSettings(listen=(each,)), network.new_id())
            for each in by_endpoint
        }
        self._names = by_endpoint
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._say)
        self._thread.start()

    def _say(self) -> None:
        number = 0
        while not self._stop.wait(0.02):
            number += 1
            for endpoint, names in self._names.items():
                for name in names:
                    if name not in self.silent:
                        key = f"imud/{name}/pose"
                        self.sessions[endpoint].put(key, pose_of(name, number))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for each in self.sessions.values():
            each.close()


@pytest.fixture
def probes() -> Iterator[Probes]:
    made = Probes({free_endpoint(): ["thigh", "shank"], free_endpoint(): ["foot"]})
    yield made
    made.close()


@contextlib.contextmanager
def body(*words: str) -> Iterator[subprocess.Popen[str]]:
    with Forked("-m", "imud", "body", *words, stdout=subprocess.PIPE) as program:
        try:
            yield program
        finally:
            program.terminate()
            program.communicate(timeout=ENDED_S)


def test_probes_of_two_daemons_become_one_body(probes: Probes, tmp_path: Path) -> None:
    file = tmp_path / "leg.toml"
    file.write_text(leg.CHAIN)
    first, second = probes.sessions
    states: list[BodyState] = []

    def keep(sample: zenoh.Sample) -> None:
        states.append(msgspec.json.decode(sample.payload.to_bytes(), type=BodyState))

    def has(is_so: Callable[[BodyState], bool]) -> None:
        """Waits for such a state, and forgets those before."""
        until(lambda: any(map(is_so, states)))
        states.clear()

    listened = probes.sessions[first].declare_subscriber("imud/body/*/state", keep)
    words = [str(file), "--connect", first, "--connect", second, "--ros2", "3"]
    words += ["--log", str(tmp_path / "logs")]
    with body(*words) as program:
        has(lambda state: state.stage == "standing" and not state.missing)
        has(lambda state: (state.body, state.t_bound_us) == ("right-leg", 600))
        probes.silent.add("foot")
        has(lambda state: state.segments[2].presence == "missing")
        has(
            lambda state: (
                state.stage == "waiting" and "foot (foot)" in state.instruction
            )
        )
        probes.silent.clear()
        has(lambda state: not state.missing)
        found = probes.sessions[first].liveliness().get("@ros2_lv/3/**")
        announced = [str(each.ok.key_expr) for each in found if each.ok]
        program.terminate()
    listened.undeclare()
    assert any("%right_leg%joint_states/" in each for each in announced)
    assert any("/%tf/" in each for each in announced)
    (log,) = (tmp_path / "logs").glob("*.mcap")
    with log.open("rb") as logged:
        topics = {
            channel.topic for _, channel, _ in make_reader(logged).iter_messages()
        }
    assert topics == {"imud/body/right-leg/state"}


def shown() -> BodyState:
    """The state that the document shows."""
    example = re.search(r"```json\n(\{.*?)```", DOCUMENT.read_text(), re.DOTALL)
    return msgspec.json.decode(example[1], type=BodyState)


def test_a_body_is_joints_and_transforms_for_ros() -> None:
    (joint, joints), (tf, transforms) = messages(shown())
    assert joint == joint_topic("right-leg")
    assert joint.name == "/imud/body/right_leg/joint_states"
    assert b"foot_flexion\0" in joints
    assert tf is TF
    assert transforms.count(b"right_leg\0") == 2
    lost = msgspec.structs.replace(
        shown(),
        segments=tuple(
            msgspec.structs.replace(each, q=None, start_m=None)
            for each in shown().segments
        ),
        joints=(msgspec.structs.replace(shown().joints[0], angles_deg=None),),
    )
    assert list(messages(lost)) == []


def test_lines_say_what_to_do_what_is_missing_and_the_angles(
    capsys: pytest.CaptureFixture[str],
) -> None:
    state = shown()
    printer = Printer(as_json=False)
    printer.put(
        msgspec.structs.replace(state, stage="standing", instruction="stand"), b""
    )
    printer.put(msgspec.structs.replace(state, remarks=("upside down",)), b"")
    gone = msgspec.structs.replace(state.segments[1], presence="missing")
    gone_state = msgspec.structs.replace(
        state, missing=("foot",), segments=(state.segments[0], gone)
    )
    printer.put(gone_state, b"")
    printer.put(state, b"")
    assert capsys.readouterr().out.splitlines() == [
        "right-leg: stand",
        "right-leg: aligned; move as you like",
        "right-leg: upside down",
        "foot: flexion 31±2 abduction 1±4 rotation -2±3",
        "right-leg: foot missing",
        "right-leg: all probes are present",
    ]
    unknown = msgspec.structs.replace(state.joints[0], angles_deg=None)
    assert line_of(unknown) == "foot: unknown"
    Printer(as_json=True).put(state, b"{}")
    assert capsys.readouterr().out == "{}\n"


def test_what_is_no_pose_of_its_probes_is_left_out() -> None:
    made = LiveBody(chain.read(leg.CHAIN, "leg"))
    add_delivery(made, "pose", Delivery("thigh", b"{", ""))
    add_delivery(made, "pose", Delivery("other", pose_of("other", 1), ""))
    thigh = made.histories["thigh"]
    assert not thigh.poses
    add_delivery(made, "pose", Delivery("thigh", pose_of("thigh", 1), ""))
    assert len(thigh.poses) == 1
    assert thigh.is_dated
    undated = pose_of("thigh", 2, t_bound_us=None, heading_sigma_deg=None)
    add_delivery(made, "pose", Delivery("thigh", undated, ""))
    assert len(thigh.poses) == 1
    assert not thigh.is_dated
    blind = pose_of("thigh", 3, heading_sigma_deg=None)
    add_delivery(made, "pose", Delivery("thigh", blind, ""))
    assert math.isnan(thigh.poses[-1][-1])


def test_what_cannot_be_is_told_on_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "leg.toml"
    assert cli.main(["body", str(file)]) == 1
    assert f"can't read {file}" in capsys.readouterr().err
    file.write_text(leg.CHAIN.replace('parent = "thigh"', 'parent = "foot"'))
    assert cli.main(["body", str(file)]) == 1
    assert "a cycle: shank > foot > shank" in capsys.readouterr().err
    file.write_text(leg.CHAIN)
    assert cli.main(["body", str(file), "--connect", free_endpoint()]) == 1
    told = capsys.readouterr().err
    assert "no imud at" in told
    assert told.count("\n") == 1
