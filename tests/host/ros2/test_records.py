# SPDX-License-Identifier: MIT
"""A probe's records as ROS 2 messages."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from imud.probes.record import Record
from imud.ros2 import topics as ros2
from imud.ros2.cdr import Level
from imud.ros2.covariance import FREE_RAD2
from imud.ros2.topics import Topic
from imud.sinks.ros2 import RosTranslator
from ros_values import FORCE, RATE, T_NS, Q, pose, raw, sent_by


@given(st.text(min_size=1))
def test_any_name_of_a_probe_becomes_one_of_ros(text: str) -> None:
    name = ros2.ros_name(text)
    assert ros2.ros_name(name) == name
    topic = Topic(f"/imud/{name}/pose", ros2.POSE_STAMPED)
    assert zenoh.KeyExpr(topic.key(0)).intersects(
        zenoh.KeyExpr(f"0/imud/{name}/pose/*/*")
    )
    assert not name[0].isdigit()
    assert "__" not in name


TIP = "/imud/tip/tip"


def status(**fields: Any) -> Record:
    values = {
        "type": "status",
        "probe": "tip",
        "probe_id": "00112233445566aa",
        "state": "streaming",
        "pose_rate_hz": 100.0,
        "quality": {"tilt_sigma_deg": 0.5, "heading_sigma_deg": None, "flags": []},
        "ledger": {"received": 10, "lost": 0, "corrupt": 0, "dropped": {"log": 0}},
        "equipment": None,
    } | fields
    return Record("tip", "status", json.dumps(values).encode(), b"", 0, T_NS, T_NS)


@pytest.fixture
def translator() -> RosTranslator:
    return RosTranslator("tip", "imud", "world")


def test_a_pose_is_said_in_four_ways(translator: RosTranslator) -> None:
    topics = sent_by(translator, pose(position_m=(1.0, 2.0, 3.0)))
    assert set(topics) == {"/imud/tip/imu/data", "/tf", "/imud/tip/pose", TIP}
    (imu,), transforms, (stamped,), (tip,) = topics.values()
    (turn,), (shift,) = (each.transforms for each in transforms)
    assert imu.header.frame_id == turn.child_frame_id == "tip"
    assert turn.header.frame_id == shift.child_frame_id == "tip_level"
    assert stamped.header.frame_id == shift.header.frame_id == "world"
    assert tip.header.frame_id == "world"
    for message in (imu, stamped, tip, turn, shift):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == T_NS
    for q in (imu.orientation, stamped.pose.orientation, turn.transform.rotation):
        assert (q.w, q.x, q.y, q.z) == Q
    unturned = shift.transform.rotation
    assert (unturned.w, unturned.x, unturned.y, unturned.z) == (1.0, 0.0, 0.0, 0.0)
    for p in (stamped.pose.position, tip.point, shift.transform.translation):
        assert (p.x, p.y, p.z) == (1.0, 2.0, 3.0)


def test_an_orientation_keeps_its_side_until_the_probe_restarts(
    translator: RosTranslator,
) -> None:
    other = tuple(-part for part in Q)
    told = [(Q, 5), (other, 10), (Q, 15), (other, 0)]
    records = [pose(q=q, t_device_us=t, position_m=(0.0,) * 3) for q, t in told]
    topics = sent_by(translator, *records)
    w = [[imu.orientation.w for imu in topics["/imud/tip/imu/data"]]]
    w += [[each.pose.orientation.w for each in topics["/imud/tip/pose"]]]
    turns = [each.transforms[0] for each in topics["/tf"]]
    w += [[t.transform.rotation.w for t in turns if t.child_frame_id == "tip"]]
    assert w == [[Q[0], Q[0], Q[0], -Q[0]]] * 3


def stroke(number: int, end: str = "button", **fields: Any) -> Record:
    """One of 0.1 m, after others of the same length."""
    values = {
        "type": "stroke",
        "end": end,
        "displacement_m": (0.1, 0.0, 0.0),
        "displacement_sigma_m": (0.001,) * 3,
        "path_m": (0.1 * number, 0.0, 0.0),
        "path_sigma_m": (0.001,) * 3,
        "t_device_us": 1_000_000 * number,
    } | fields
    return Record("tip", "stroke", b"{}", b"", 1, T_NS, T_NS, values=values)


def at(number: float, t_us: int = 0) -> Record:
    """The pose after that stroke, a millimetre above the sensor."""
    place = (0.1 * number, 0.0, 0.001)
    found = pose(position_m=place, t_device_us=int(1_000_000 * number) + t_us)
    return replace(found, t_ns=T_NS + int(1e9 * number))


def paths(translator: RosTranslator, *records: Record) -> list[Any]:
    return sent_by(translator, *records).get("/imud/tip/path", [])


RUNNING = stroke(1, "running")


def test_a_path_has_the_places_of_the_tip_since_its_origin(
    translator: RosTranslator,
) -> None:
    moving = pose(position_m=(0.05, 0.0, 0.0), t_device_us=500_000)
    told = paths(
        translator,
        *(at(0), RUNNING, moving, stroke(1), at(1), at(1.5)),
        *(stroke(2, "running"), stroke(2), at(2)),
    )
    assert [len(path.poses) for path in told] == [2, 3]
    path = told[-1]
    assert path.header.frame_id == "world"
    for number, stop in enumerate(path.poses):
        assert stop.header.frame_id == "world"
        stamp = stop.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == T_NS + number * 10**9
        place = stop.pose.position
        assert (place.x, place.y, place.z) == pytest.approx((0.1 * number, 0.0, 0.001))
        q = stop.pose.orientation
        assert (q.w, q.x, q.y, q.z) == Q


TARED = replace(RUNNING, topic="event", values={"type": "event", "event": "tared"})
LOST = stroke(2, "gap", displacement_m=None, path_m=None)


@pytest.mark.parametrize("end", [LOST, TARED])
def test_a_path_that_ends_is_empty_once(translator: RosTranslator, end: Record) -> None:
    told = paths(translator, at(0), RUNNING, stroke(1), at(1), end, end, at(3))
    assert [len(path.poses) for path in told] == [2, 0]


def test_no_path_is_told_without_a_place_of_the_tip(translator: RosTranslator) -> None:
    nowhere = pose(position_m=None, t_device_us=1_000_000)
    assert paths(translator, nowhere, RUNNING, stroke(1), nowhere, at(2)) == []


def test_a_pose_without_a_position_says_none_in_the_world(
    translator: RosTranslator,
) -> None:
    topics = sent_by(translator, pose(position_m=None))
    assert list(topics) == ["/imud/tip/imu/data", "/tf"]
    (transform,) = topics["/tf"][0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("tip_level", "tip")


def test_tilt_is_about_the_level_axes_and_heading_about_the_one_that_points_up(
    translator: RosTranslator,
) -> None:
    # On its side, the probe's own x points up: what is said stays the world's.
    on_its_side = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    (imu,) = sent_by(translator, pose(q=on_its_side))["/imud/tip/imu/data"]
    expected = np.diag(np.radians([0.5, 0.5, 2.0]) ** 2)
    assert np.array_equal(imu.orientation_covariance.reshape(3, 3), expected)


def test_a_free_heading_may_be_anything(translator: RosTranslator) -> None:
    (imu,) = sent_by(translator, pose(heading_sigma_deg=None))["/imud/tip/imu/data"]
    turns = np.linspace(-np.pi, np.pi, 100_001)
    assert pytest.approx(turns.var(), rel=1e-4) == FREE_RAD2
    assert imu.orientation_covariance[8] == FREE_RAD2


def test_an_orientation_that_still_settles_is_not_said(
    translator: RosTranslator,
) -> None:
    topics = sent_by(translator, pose(tilt_sigma_deg=None, heading_sigma_deg=None))
    assert list(topics) == ["/imud/tip/imu/data"]
    (imu,) = topics["/imud/tip/imu/data"]
    assert imu.orientation_covariance[0] == -1


def test_without_samples_an_imu_says_that_it_has_none(
    translator: RosTranslator,
) -> None:
    (imu,) = sent_by(translator, pose())["/imud/tip/imu/data"]
    assert imu.angular_velocity_covariance[0] == -1
    assert imu.linear_acceleration_covariance[0] == -1


@pytest.mark.parametrize("age_us", [0, 5_000, 20_000, -20_000])
def test_a_pose_is_joined_with_the_sample_before_it(
    translator: RosTranslator, age_us: int
) -> None:
    before = pose(t_device_us=999_000)
    topics = sent_by(translator, before, raw(), pose(t_device_us=1_000_000 + age_us))
    imu = topics["/imud/tip/imu/data"][-1]
    rate, force = imu.angular_velocity, imu.linear_acceleration
    assert (rate.x, rate.y, rate.z) == RATE
    assert (force.x, force.y, force.z) == FORCE


def test_an_old_sample_is_not_joined(translator: RosTranslator) -> None:
    topics = sent_by(translator, pose(), raw(), pose(t_device_us=1_020_001))
    first, last = topics["/imud/tip/imu/data"]
    assert first.angular_velocity_covariance[0] == -1
    assert last.angular_velocity_covariance[0] == -1


def test_samples_without_poses_go_out_by_themselves(translator: RosTranslator) -> None:
    topics = sent_by(translator, raw(), pose(), raw(t_device_us=2_000_000))
    assert len(topics["/imud/tip/imu/data"]) == 2  # the first, and the pose's
    (imu,) = sent_by(translator, raw(t_device_us=2_000_001))["/imud/tip/imu/data"]
    assert imu.orientation_covariance[0] == -1
    assert imu.angular_velocity.x == RATE[0]


def test_samples_before_the_first_hello_have_no_scale(
    translator: RosTranslator,
) -> None:
    assert sent_by(translator, raw(acc_m_s2=None, gyr_rad_s=None)) == {}


def test_a_magnetic_field_is_in_tesla(translator: RosTranslator) -> None:
    topics = sent_by(translator, pose(), raw(mag_uT=(20.0, -1.0, 45.0)))
    (mag,) = topics["/imud/tip/imu/mag"]
    field = mag.magnetic_field
    assert (field.x, field.y, field.z) == pytest.approx((20e-6, -1e-6, 45e-6))
    assert mag.header.frame_id == "tip"


def verdict(translator: RosTranslator, **fields: Any) -> tuple[int, str]:
    (message,) = sent_by(translator, status(**fields))["/diagnostics"]
    (one,) = message.status
    assert (one.name, one.hardware_id) == ("imud: tip", "00112233445566aa")
    return one.level, one.message


def test_the_state_of_a_probe_is_a_level(translator: RosTranslator) -> None:
    assert verdict(translator) == (Level.OK, "streaming")
    assert verdict(translator, state="idle") == (Level.OK, "idle")
    assert verdict(translator, state="gone") == (Level.STALE, "gone")
    assert verdict(translator, state="silent") == (Level.STALE, "silent")
    assert verdict(translator, state="fault") == (Level.ERROR, "fault")
    assert verdict(translator, state="other schema") == (Level.ERROR, "other schema")


def test_what_a_pose_lacks_is_a_warning_while_it_streams(
    translator: RosTranslator,
) -> None:
    flawed = {"flags": ["at_rest", "mag_disturbed", "gap"]}
    assert verdict(translator, quality=flawed) == (
        Level.WARN,
        "magnetic field is disturbed, samples are missing",
    )
    assert verdict(translator, state="idle", quality=flawed) == (Level.OK, "idle")
    assert verdict(translator, equipment={"power": ["low"], "clock": "spare"}) == (
        Level.WARN,
        "battery is low, crystal has failed",
    )


def test_what_is_wrong_with_the_sensors_is_told(translator: RosTranslator) -> None:
    broken = {"words": ["no answer at 0x68"], "flags": []}
    told = verdict(translator, state="fault", sensors=broken)
    assert told == (Level.ERROR, "fault: no answer at 0x68")
    flawed = {"flags": ["self_test_failed"]}
    told = verdict(translator, quality=flawed)
    assert told == (Level.WARN, "a sensor failed its self-test")


def test_a_loss_is_a_warning_once(translator: RosTranslator) -> None:
    ledger = {"lost": 1, "earlier_boots": {"lost": 2}, "corrupt": 4}
    ledger |= {"dropped": {"log": 5, "zenoh": 1}}
    told = (Level.WARN, "3 lost, 4 corrupt, 6 dropped")
    assert verdict(translator, ledger=ledger) == told
    assert verdict(translator, ledger=ledger) == (Level.OK, "streaming")
    restarted = {"lost": 0, "earlier_boots": {"lost": 4}}
    told_again = verdict(translator, ledger=ledger | restarted)
    assert told_again == (Level.WARN, "1 lost")


def test_figures_of_a_probe_are_in_its_diagnostics(translator: RosTranslator) -> None:
    (message,) = sent_by(translator, status(equipment={"battery_v": 3.9}))[
        "/diagnostics"
    ]
    values = {pair.key: pair.value for pair in message.status[0].values}
    assert values["pose_rate_hz"] == "100.0"
    assert values["tilt_sigma_deg"] == "0.5"
    assert values["heading_sigma_deg"] == "unknown"
    assert (values["received"], values["lost"], values["dropped"]) == ("10", "0", "0")
    assert values["battery_v"] == "3.9"


def test_a_status_of_which_little_is_known_is_said(translator: RosTranslator) -> None:
    bare = status(quality=None, ledger=None, state=None)
    (message,) = sent_by(translator, bare)["/diagnostics"]
    assert message.status[0].level == Level.OK
