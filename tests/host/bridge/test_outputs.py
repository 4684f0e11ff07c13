# SPDX-License-Identifier: MIT
"""What programs of other fields get of a pose: by their own libraries and programs.
What is withheld is absent, in each of them.
"""

from __future__ import annotations

import json
import logging
import math
import secrets
import select
import subprocess
import sys
import time
from functools import partial
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage

from bridged import (
    ID,
    Broker,
    Follower,
    Receiver,
    needs_mosquitto,
    pose,
    status,
)
from fakes import free_address
from imud.bridge import mavlink
from imud.bridge.lsl import CHANNELS, LslOutput
from imud.bridge.mavlink import MavlinkOutput
from imud.bridge.mqtt import MqttOutput
from imud.bridge.osc import OscOutput
from imud.bridge.output import AWAY
from imud.bridge.run import opened
from imud.bridge.vmc import VmcOutput, bones_of
from imud.cli import main
from imud.client import Body, Event, Mark, Segment
from imud.config.settings import (
    Config,
    LslSettings,
    MavlinkSettings,
    MqttSettings,
    OscSettings,
    VmcSettings,
)
from imud.errors import ConfigError
from imud.published import SinceOrigin
from imud.rotation import from_heading_pitch_roll, from_rotation_vector, multiply

WITHHELD = {"heading_sigma_deg": None, "flags": ("heading_free",)}
STARTING = {"tilt_sigma_deg": None, "heading_sigma_deg": None, "flags": ("starting",)}


def bundle(data: bytes) -> dict[str, Any]:
    found = OscBundle(data)
    assert found.timestamp == pytest.approx(time.time(), abs=3600)
    return {each.address: each.params for each in found}


def test_oscdump_prints_each_part_of_a_pose_at_its_address() -> None:
    port = free_address()[1]
    out = subprocess.PIPE
    command = ["stdbuf", "-oL", "oscdump", str(port)]
    with subprocess.Popen(command, stdout=out, text=True) as dump:
        assert dump.stdout is not None
        output = OscOutput(OscSettings(to=f"127.0.0.1:{port}"))
        try:
            while not select.select([dump.stdout], [], [], 0.05)[0]:
                assert dump.poll() is None
                output.status(status())  # until it has opened its port
            lines = [dump.stdout.readline()]
            sent = pose(position_m=(0.25, 0.0, -0.5))
            output.pose(sent)
            while "flags" not in lines[-1]:
                lines.append(dump.stdout.readline())
        finally:
            dump.kill()
            output.close()
    said = [line.split(" ", 2) for line in lines if "/state" not in line]
    parts = {address: text.split() for _, address, text in said}
    q = [float(each) for each in parts["/imud/stylus/q"][1:]]
    assert q == pytest.approx(sent.q, abs=1e-6)
    names = ("yaw", "pitch", "roll", "sigma/tilt", "sigma/heading")
    for name, value in zip(names, (*sent.angles("nautical"), 0.37, 1.25), strict=True):
        assert float(parts[f"/imud/stylus/{name}"][1]) == pytest.approx(value, abs=1e-5)
    assert parts["/imud/stylus/position"][1:] == ["0.250000", "0.000000", "-0.500000"]
    # The time tag is that of the sample, in seconds since 1900 and a fraction.
    seconds, fraction = (int(each, 16) for each in said[0][0].split("."))
    tagged_s = seconds - 2_208_988_800 + fraction / 2**32
    assert tagged_s == pytest.approx((sent.t_ns or 0) / 1e9, abs=1e-6)


def test_osc_leaves_out_what_is_withheld() -> None:
    with Receiver() as receiver:
        output = OscOutput(OscSettings(to=receiver.to))
        output.pose(pose(**WITHHELD))
        names = {"pitch", "roll", "sigma/tilt", "flags"}
        assert {*bundle(receiver.hear())} == {f"/imud/stylus/{n}" for n in names}
        output.pose(pose(**STARTING))
        assert bundle(receiver.hear()) == {"/imud/stylus/flags": ["starting"]}
        output.status(status(AWAY, probe="left [1]"))
        assert bundle(receiver.hear()) == {"/imud/left--1-/state": [AWAY]}
        output.close()
        output = OscOutput(OscSettings(to=receiver.to, relative_heading=True))
        output.pose(pose(**WITHHELD))
        heard = bundle(receiver.hear())
        assert heard["/imud/stylus/q"] == pytest.approx(pose().q)
        assert "/imud/stylus/sigma/heading" not in heard
        # An origin gives a heading that the field does not.
        since = SinceOrigin(heading_sigma_deg=0.5, tilt_sigma_deg=0.25, age_s=1.0)
        output.pose(pose(**WITHHELD, since_origin=since))
        heard = bundle(receiver.hear())
        assert heard["/imud/stylus/sigma/heading"] == [0.5]
        output.close()


def test_a_receiver_that_is_away_is_told_of_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with Receiver() as receiver:
        output = OscOutput(OscSettings(to=receiver.to))
    with caplog.at_level(logging.WARNING, "imud"):
        for _ in range(10):
            output.pose(pose())
    output.close()
    (line,) = caplog.messages
    assert line == f"osc: {receiver.to}: nobody receives there; sending goes on"


@pytest.mark.parametrize(
    ("name", "extra", "module"),
    [
        ("osc", "osc", "pythonosc.osc_message_builder"),
        ("vmc", "osc", "pythonosc.osc_message_builder"),
        ("lsl", "lsl", "pylsl"),
        ("mqtt", "mqtt", "paho.mqtt.client"),
        ("mavlink", "mavlink", "pymavlink.dialects.v20.common"),
    ],
)
def test_without_its_library_an_output_says_what_to_install(
    name: str, extra: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigError, match=rf"pip install 'imu-probe\[{extra}\]'"):
        opened(name, Config())


def body(**turns: Any) -> Body:
    """A right leg; standing but for these rotations about the body's world axes."""
    standing = np.array([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])
    segments = []
    for name, parent in {"thigh": None, "shank": "thigh", "foot": "shank"}.items():
        turn = turns.get(name, (0.0, 0.0, 0.0))
        quat = None
        if turn is not None:
            quat = multiply(from_rotation_vector(np.array(turn)), standing).tolist()
        segments.append(Segment(name=name, parent=parent, presence="ok", q=quat))
    return Body(
        body="leg",
        side="right",
        number=1,
        t_ns=0,
        t_bound_us=None,
        stage="running",
        missing=tuple(each.name for each in segments if each.q is None),
        segments=tuple(segments),
        joints=(),
    )


def test_a_limb_is_bones_that_turn_from_their_parents() -> None:
    def same(found: Any, *wanted: float) -> None:
        assert found == pytest.approx(wanted, abs=1e-12)

    bones = bones_of(body())
    assert [*bones] == ["RightUpperLeg", "RightLowerLeg", "RightFoot"]
    for quat in bones.values():
        same(quat, 1.0, 0.0, 0.0, 0.0)
    # The thigh is raised ahead: about the left. In Unity's left-handed axes, where a
    # turn about x takes up to ahead, what hangs goes ahead by a negative one.
    half = math.sqrt(0.5)
    raised = (0.0, -math.pi / 2, 0.0)
    bones = bones_of(body(thigh=raised))
    same(bones["RightUpperLeg"], half, -half, 0.0, 0.0)
    same(bones["RightLowerLeg"], half, half, 0.0, 0.0)
    # All of it turned to the left, about up: in Unity to the right is positive.
    turned = dict.fromkeys(("thigh", "shank", "foot"), (0.0, 0.0, math.pi / 2))
    bones = bones_of(body(**turned))
    same(bones["RightUpperLeg"], half, 0.0, -half, 0.0)
    same(bones["RightFoot"], 1.0, 0.0, 0.0, 0.0)
    # Without its shank neither that has a rotation nor what hangs from it.
    assert [*bones_of(body(shank=None))] == ["RightUpperLeg"]


def test_vmc_says_whether_the_tracking_is_good() -> None:
    with Receiver() as receiver:
        output = VmcOutput(VmcSettings(to=receiver.to))

        def heard() -> tuple[str, list[Any]]:
            message = OscMessage(receiver.hear())
            return message.address, message.params

        output.pose(pose(**WITHHELD))
        output.tick()
        assert heard() == ("/VMC/Ext/OK", [1, 3, 0, 0])
        assert heard()[0] == "/VMC/Ext/T"
        output.pose(pose())
        address, (name, *place) = heard()
        assert (address, name) == ("/VMC/Ext/Tra/Pos", "stylus")
        assert place == pytest.approx([0, 0, 0, -0.36, 0.0, 0.48, 0.8])
        output.body(body(foot=None))
        assert [heard()[1][0] for _ in range(2)] == ["RightUpperLeg", "RightLowerLeg"]
        for missing, tracking in ((None, 0), ((0.0, 0.0, 0.0), 1)):
            output.body(body(foot=missing))
            output.pose(pose())
            output.tick()
            while (told := heard())[0] != "/VMC/Ext/OK":
                pass
            assert told[1] == [1, 3, 0, tracking]
        output.close()


def event(name: str) -> Event:
    head = {"probe": "stylus", "seq": 1, "number": 1, "missing": 0, "t_device_us": 1}
    return Event(**head, t_ns=time.time_ns(), event=name, cause="button", detail=0)


def inlet_of(pylsl: Any, source: str) -> Any:
    found: list[Any] = []
    while not found:
        found = pylsl.resolve_byprop("source_id", source, timeout=10.0)
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream()
    return inlet


def test_an_inlet_of_lsl_gets_poses_at_their_time_and_markers() -> None:
    pylsl = pytest.importorskip("pylsl")
    own = secrets.token_hex(8)  # others may run this on the same machine
    output = LslOutput(LslSettings())
    try:
        output.pose(pose())  # before its status: it has no stream
        output.status(status(probe_id=own))
        poses = inlet_of(pylsl, f"imud-{own}")
        markers = inlet_of(pylsl, f"imud-{own}-markers")
        info = poses.info()
        assert (info.name(), info.type(), info.nominal_srate()) == (
            "stylus",
            "MoCap",
            100,
        )
        channels = info.desc().child("channels")
        channel, read = channels.child("channel"), []
        while channel.name():
            about = (channel.child_value(key) for key in ("label", "unit", "type"))
            read.append(tuple(about))
            channel = channel.next_sibling()
        assert read == [*CHANNELS]
        before_s, sent = pylsl.local_clock(), pose(utc_host=output._clock._host.host)
        output.pose(sent)
        values, time_s = poses.pull_sample()
        assert before_s <= time_s <= pylsl.local_clock()
        told = dict(zip((label for label, _, _ in CHANNELS), values, strict=True))
        assert tuple(told[f"q_{axis}"] for axis in "wxyz") == sent.q
        angles = tuple(told[name] for name in ("yaw", "pitch", "roll"))
        assert angles == sent.angles("nautical")
        assert (told["tilt_sigma"], told["heading_sigma"]) == (0.37, 1.25)
        assert told["time_bound"] >= 250
        assert math.isnan(told["tip_x"])
        output.pose(pose(**WITHHELD, utc_host="another", utc_bound_us=None))
        values, _ = poses.pull_sample()
        absent = {
            name for name, value in zip(told, values, strict=True) if value != value
        }
        withheld = {"q_w", "q_x", "q_y", "q_z", "yaw", "heading_sigma", "time_bound"}
        assert absent == withheld | {"tip_x", "tip_y", "tip_z"}
        for name in ("button_pressed", "tared"):
            output.event(event(name))
        blank = {name: None for name in Mark.__struct_fields__}
        of = {"probe": "stylus", "t_ns": time.time_ns(), "state": "new"}
        output.mark(Mark(**blank | of | {"value": 0.42, "unit": "N", "text": "again"}))
        output.status(status("gone", probe_id=own))
        said = [markers.pull_sample()[0][0] for _ in range(3)]
        assert said == ["button_pressed", "mark new 0.42 N again", "state gone"]
    finally:
        output.close()


@needs_mosquitto
def test_home_assistant_finds_a_probe_and_a_broker_that_comes_back_is_told(
    tmp_path: Any,
) -> None:
    with Broker(tmp_path, "allow_anonymous true") as broker:
        to = f"{broker.host}:{broker.port}"
        output = MqttOutput(MqttSettings(to=to, digits=2))
        try:
            with Follower(broker) as home:
                home.hear_while(output.tick, "imud/availability", b"online")
                output.status(status(equipment={"battery_v": 3.9}))
                place = f"homeassistant/sensor/imud_{ID}/heading_deg/config"
                found = json.loads(home.hear(place).payload)
                assert found["value_template"] == "{{ value_json.heading_deg }}"
                assert found["unit_of_measurement"] == "°"
                assert [each["topic"] for each in found["availability"]] == [
                    "imud/availability",
                    "imud/stylus/availability",
                ]
                home.hear(found["state_topic"])
                for _ in range(3):  # the same: one message
                    output.pose(pose())
                output.pose(pose(**WITHHELD))
                first, second = (
                    json.loads(home.hear("imud/stylus/state").payload) for _ in range(2)
                )
                yaw = pose().angles("aerospace").yaw_deg % 360
                assert first["heading_deg"] == round(yaw, 2)
                assert (first["tilt_sigma_deg"], first["battery_v"]) == (0.37, 3.9)
                assert (second["heading_deg"], second["heading_sigma_deg"]) == (
                    None,
                    None,
                )
                assert second["tilt_deg"] == first["tilt_deg"]
                output.status(status("gone"))
                assert home.hear("imud/stylus/availability").payload == b"offline"
                gone = json.loads(home.hear("imud/stylus/state").payload)
                assert (gone["tilt_deg"], gone["state"]) == (None, "gone")
            broker.stop()
            while output._client.is_connected():
                time.sleep(0.01)
            output.pose(pose())  # nobody keeps it
            broker.start()
            with Follower(broker) as home:
                now = partial(output.status, status())
                home.hear_while(now, "imud/stylus/availability", b"online")
        finally:
            output.close()
        with Follower(broker) as home:
            last = home.hear("imud/availability")
            assert (last.payload, last.retain) == (b"offline", True)
        output = MqttOutput(MqttSettings(to=to))
        with Follower(broker) as home:  # the next bridge does not know the probe
            home.hear_while(output.tick, "imud/stylus/availability", b"offline")
        output.close()


@needs_mosquitto
@pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <ssl.SSLSocket"  # paho's, of a failed handshake
)
def test_a_broker_is_trusted_by_its_certificate_and_admits_a_user_by_password(
    tmp_path: Any, caplog: pytest.LogCaptureFixture
) -> None:
    keys = tmp_path / "keys"
    assert main(["keys", "init", str(keys), "--name", "127.0.0.1"]) == 0
    files = (tmp_path / "users", tmp_path / "wrong", tmp_path / "right")
    users, wrong, right = map(str, files)
    files[0].write_text("anna:secret\n")
    files[1].write_text("guess\n")
    files[2].write_text("secret\n")
    subprocess.run(["mosquitto_passwd", "-U", users], check=True)  # hashes it
    lines = ("allow_anonymous false", f"password_file {users}")
    lines += (f"certfile {keys / 'server.pem'}", f"keyfile {keys / 'server.key'}")
    caplog.set_level(logging.INFO, "imud")
    with Broker(tmp_path, *lines) as broker:
        for ca_file, password, said in (
            ("", right, "its certificate is unknown: set ca_file"),
            (str(keys / "ca.pem"), wrong, "Not authorized: check [mqtt] user and "),
            (str(keys / "ca.pem"), right, "connected"),
        ):
            caplog.clear()
            to = f"{broker.host}:{broker.port}"
            secured = MqttSettings(
                to=to, tls=True, ca_file=ca_file, user="anna", password_file=password
            )
            output = MqttOutput(secured)
            while not caplog.messages:
                time.sleep(0.01)
            output.close()
            assert said in caplog.messages[0]


def test_the_parser_of_mavlink_reads_attitude_covariance_and_heartbeat() -> None:
    parser = common.MAVLink(None)
    with Receiver() as receiver:
        output = MavlinkOutput(MavlinkSettings(to=receiver.to))

        def heard() -> Any:
            (message,) = parser.parse_buffer(receiver.hear())
            return message

        output.pose(pose(**WITHHELD))
        output.status(status("gone"))
        output.status(status())
        beat = heard()  # the first of all
        assert (beat.get_type(), beat.type) == ("HEARTBEAT", common.MAV_TYPE_IMU)
        assert beat.system_status == common.MAV_STATE_ACTIVE
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 200)
        # Heading east, pitched up by 30 degrees, the right side down by 10.
        up, down = np.radians([-30.0, 10.0])
        q = tuple(from_heading_pitch_roll(0.0, up, down).tolist())
        sent = pose(q=q)
        output.pose(sent)
        told = heard()
        assert told.get_type() == "ATTITUDE_QUATERNION_COV"
        assert told.time_usec == (sent.t_ns or 0) // 1000
        assert all(math.isnan(each) for each in (told.rollspeed, told.yawspeed))
        angles = np.degrees(aircraft(np.array(told.q)))
        assert angles == pytest.approx([10.0, 30.0, 90.0], abs=1e-4)
        assert np.array(told.covariance).reshape(3, 3) == pytest.approx(
            by_differences(np.array(told.q)), rel=1e-3, abs=1e-9
        )
        upright = mavlink.ned_of(
            tuple(from_heading_pitch_roll(0.0, -math.pi / 2, 0.0).tolist())
        )
        free = mavlink.euler_covariance(upright, (1e-4, *[0.0] * 7, 1e-3))
        assert (free[0], free[4], free[8]) == (
            mavlink.FREE_RAD2,
            1e-4,
            mavlink.FREE_RAD2,
        )
        for name in ("b", "c", "d"):
            output.status(status(probe=name))
        beats = [heard() for _ in range(3)]
        places = [(each.get_srcSystem(), each.get_srcComponent()) for each in beats]
        assert places == [(1, 201), (1, 202), (2, 200)]
        output.close()


def aircraft(q: Any) -> Any:
    """Roll, pitch and yaw of a quaternion to north-east-down."""
    w, x, y, z = q / np.linalg.norm(q)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return np.array([roll, math.asin(2 * (w * y - z * x)), yaw])


def by_differences(q: Any) -> Any:
    """The covariance of these angles, from small errors about the axes of the world."""
    small = 1e-6
    columns = [
        (aircraft(multiply(from_rotation_vector(small * axis), q)) - aircraft(q))
        / small
        for axis in np.eye(3)
    ]
    slopes = np.array(columns).T
    sigmas = np.radians([0.37, 0.37, 1.25])
    return slopes @ np.diag(sigmas**2) @ slopes.T
