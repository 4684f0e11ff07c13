# SPDX-License-Identifier: MIT
"""`subscribe`, with a daemon and without: order, what was missed, and how it ends."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import threading
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from configured import running
from fakes import POSE, DaemonProcess
from imud.client import (
    Body,
    Client,
    Delivery,
    Event,
    Mark,
    Missed,
    Pose,
    Raw,
    Status,
    Subscription,
    Topic,
    subscribe,
)
from imud.errors import ConfigError, DaemonNotFound
from streaming import Streaming


class Line:
    """A daemon's messages without a daemon: calls back like a client."""

    is_connected = True

    def __init__(self) -> None:
        self.callbacks: dict[str, Any] = {}
        self.history: dict[str, int] = {}
        self.is_closed = False

    def listen(self, topic: str, _: str | None, callback: Any, *, history: int) -> None:
        self.callbacks[topic] = callback
        self.history[topic] = history

    def close(self) -> None:
        self.is_closed = True

    def say(
        self,
        number: int,
        *,
        topic: str = "pose",
        source: str = "one",
        probe: str = "p",
        carrier: str = "",
        **changes: Any,
    ) -> None:
        values = {
            "type": topic,
            "probe": probe,
            "seq": number * 2,
            "number": number,
            "missing": 0,
            "t_device_us": number * 10_000,
            "q": POSE["q"],
            "position_m": None,
            "normal": None,
            "tilt_sigma_deg": 0.37,
            "heading_sigma_deg": None,
            "flags": ["at_rest"],
            "event": "tared",
            "cause": "command",
            "detail": 0,
        } | changes
        payload = json.dumps(values).encode()
        self.callbacks[topic](Delivery(probe, payload, source, carrier))


def line_and(
    *topics: str, waiting_max: int = 100, **options: Any
) -> tuple[Line, Subscription[Any]]:
    line: Any = Line()
    given = {"history": 0, "seconds": None} | options
    topics = topics or ("pose",)
    given = {"probe": None} | given
    return line, Subscription(line, topics=topics, waiting_max=waiting_max, **given)


def numbers(subscription: Subscription[Any], count: int) -> list[int]:
    return [pose.number for pose in islice(subscription, count)]


def test_what_came_before_the_subscription_is_not_missed() -> None:
    line, subscription = line_and()
    line.say(1000, missing=7)
    line.say(1001)
    assert numbers(subscription, 2) == [1000, 1001]
    assert subscription.missed == Missed()


def test_a_hole_in_the_numbers_is_the_network_s_and_missing_is_the_wire_s() -> None:
    line, subscription = line_and()
    line.say(5)
    line.say(9, missing=2)
    line.say(10, missing=1)
    assert numbers(subscription, 3) == [5, 9, 10]
    assert subscription.missed == Missed(wire=3, network=3)
    assert subscription.missed.total == 6
    assert subscription.missed_of("p") == subscription.missed
    assert subscription.missed_of("q") == Missed()


def test_what_was_lost_at_the_end_is_known_by_the_status() -> None:
    line, subscription = line_and("pose", "status")
    told = {"probe_id": "p", "state": "streaming", "port": "", "t_ns": 0}
    told |= {"pose_rate_hz": 100.0, "ledger": {}, "topic": "status"}
    line.say(5)
    line.say(0, quality={"number": 5}, **told)
    assert subscription.missed == Missed()
    line.say(0, quality={"number": 9}, **told)
    assert subscription.missed == Missed(network=4)
    line.say(8)  # overtaken
    assert subscription.missed == Missed(network=3)
    line.say(10)
    assert subscription.missed == Missed(network=3)
    # Another daemon's number says nothing of this one's poses.
    line.say(0, quality={"number": 90}, source="two", **told)
    assert subscription.missed == Missed(network=3)


def test_a_wire_s_loss_is_told_by_each_topic_and_counted_once() -> None:
    line, subscription = line_and("pose", "event")
    for topic in ("pose", "event"):
        line.say(1, topic=topic)
        line.say(2, topic=topic, missing=4)
    assert subscription.missed_of("p", "event").wire == 4
    assert subscription.missed == Missed(wire=4)


def test_probes_are_counted_apart() -> None:
    line, subscription = line_and()
    for probe, step in (("a", 1), ("b", 3)):
        line.say(1, probe=probe)
        line.say(1 + step, probe=probe)
    assert subscription.missed_of("a") == Missed()
    assert subscription.missed_of("b") == Missed(network=2)


def test_a_probe_is_counted_on_under_another_name() -> None:
    line, subscription = line_and()
    line.say(1, probe="a", carrier="1" * 16)
    line.say(2, probe="b", carrier="1" * 16)
    line.say(7, probe="b", carrier="1" * 16)
    assert subscription.missed == Missed(network=4)
    assert subscription.missed_of("b") == subscription.missed_of("1" * 16)


def test_a_name_that_goes_to_another_probe_and_back_loses_nothing() -> None:
    line, subscription = line_and(probe="stylus")
    for number, carrier in ((500, "1"), (3, "2"), (4, "2"), (900, "1"), (902, "1")):
        line.say(number, probe="stylus", carrier=carrier * 16)
    assert numbers(subscription, 5) == [500, 3, 4, 900, 902]
    assert subscription.missed == Missed(network=1)


@pytest.mark.parametrize("over", [0, 1, 50])
def test_a_full_queue_drops_its_oldest_and_counts_them(over: int) -> None:
    line, subscription = line_and(waiting_max=10)
    for number in range(1, 11 + over):
        line.say(number)
    assert numbers(subscription, 10) == list(range(1 + over, 11 + over))
    assert subscription.missed == Missed(queue=over)


def test_another_daemon_counts_anew_and_that_is_told() -> None:
    line, subscription = line_and()
    line.say(500)
    line.say(4, source="two")
    line.say(5, source="two")
    assert numbers(subscription, 3) == [500, 4, 5]
    assert subscription.missed == Missed(network=3, daemon_restarts=1)


def test_without_a_source_a_lower_number_is_of_another_daemon() -> None:
    line, subscription = line_and()
    line.say(500, source="")
    line.say(1, source="")
    assert subscription.missed == Missed(daemon_restarts=1)


def test_what_came_twice_is_given_once() -> None:
    line, subscription = line_and()
    for number in (1, 2, 2, 1, 3):
        line.say(number)
    assert numbers(subscription, 3) == [1, 2, 3]
    assert subscription.missed == Missed()


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b'{"probe":"p"}', b"\xff", b"0"])
def test_what_is_no_message_is_counted_and_left_out(payload: bytes) -> None:
    line, subscription = line_and()
    line.callbacks["pose"](Delivery("p", payload, "one"))
    line.say(1)
    assert numbers(subscription, 1) == [1]
    assert subscription.missed == Missed(unreadable=1)


def test_history_is_of_poses_alone() -> None:
    line, _ = line_and("pose", "event", history=20)
    assert line.history == {"pose": 20, "event": 0}


def test_an_iteration_ends_when_it_is_closed_from_elsewhere() -> None:
    line, subscription = line_and()
    closing = threading.Timer(0.05, subscription.close)
    closing.start()
    assert list(subscription) == []
    closing.join()
    assert line.is_closed


def test_an_iteration_ends_after_its_seconds() -> None:
    line, subscription = line_and(seconds=0.05)
    line.say(1)
    assert len(list(subscription)) == 1
    assert line.is_closed


def test_an_asynchronous_iteration_wakes_and_ends() -> None:
    line, subscription = line_and()

    async def follow() -> list[int]:
        found = []
        async with subscription:
            speaking = threading.Timer(0.05, line.say, (7,))
            speaking.start()
            async for pose in subscription:
                found.append(pose.number)
                if len(found) == 2:
                    break
                line.say(8)
            speaking.join()
        return found

    assert asyncio.run(follow()) == [7, 8]
    assert line.is_closed
    line.say(9)  # its loop has ended


def test_an_asynchronous_iteration_ends_after_its_seconds() -> None:
    line, subscription = line_and(seconds=0.05)
    line.say(1)

    async def follow() -> list[int]:
        return [pose.number async for pose in subscription]

    assert asyncio.run(follow()) == [1]


@pytest.mark.parametrize(
    "options",
    [
        {"topics": ()},
        {"topics": ("pose", "frame")},
        {"history": -1},
        {"waiting_max": 0},
    ],
)
def test_options_that_can_not_be_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ConfigError):
        subscribe(**options)


def test_no_daemon_is_said_with_what_to_do() -> None:
    with pytest.raises(DaemonNotFound, match="imud run"):
        subscribe(endpoint="tcp/127.0.0.1:9")


def test_importing_imud_does_not_load_the_network() -> None:
    code = "import sys, imud; assert 'zenoh' not in sys.modules; imud.subscribe"
    subprocess.run([sys.executable, "-c", code], check=True)
    import imud

    assert imud.subscribe is subscribe
    with pytest.raises(AttributeError, match="nonsense"):
        _ = imud.nonsense  # type: ignore[attr-defined]


# With a daemon.


def start(chain: Chain, subscription: Subscription[Any]) -> Any:
    """Says poses until one comes: from there on all do."""
    with Streaming(chain.port, chain.probe, 0.05):
        return next(subscription)


def test_all_kinds_come_typed(chain: Chain) -> None:
    topics: tuple[Topic, ...] = ("pose", "raw", "event", "status")
    with subscribe(topics=topics, endpoint=chain.daemon.endpoint) as subscription:
        start(chain, subscription)
        chain.port.write(b"".join(map(chain.probe.say, ("pose", "raw", "event"))))
        found: dict[type, Any] = {}
        while len(found) < 4:
            message = next(subscription)
            found[type(message)] = message
        assert subscription.missed == Missed()
        assert subscription.is_connected
    assert found[Pose].q == POSE["q"]
    assert found[Pose].probe == chain.probe.name
    assert found[Pose].yaw_pitch_roll_deg == pytest.approx((90.0, -90.0, 0.0))
    assert found[Raw].acc_counts == (0, -16, 2048)
    assert found[Event].event == "stream_started"
    assert found[Status].probe_id == chain.probe.name


def test_who_comes_late_gets_the_history_first_and_misses_nothing(
    chain: Chain,
) -> None:
    with subscribe(endpoint=chain.daemon.endpoint) as early:
        start(chain, early)
        chain.port.write(chain.probe.poses(50))
        last = chain.probe.sequence - 1
        while (pose := next(early)).seq < last:
            pass
        with subscribe(endpoint=chain.daemon.endpoint, history=20) as late:
            before = [next(late).number for _ in range(20)]
            assert before == list(range(pose.number - 19, pose.number + 1))
            assert start(chain, late).number == pose.number + 1
            assert late.missed == Missed()


def test_a_status_says_the_number_of_the_last_pose(chain: Chain) -> None:
    topics: tuple[Topic, ...] = ("pose", "status")
    last, said = 0, None
    with (
        subscribe(topics=topics, endpoint=chain.daemon.endpoint) as subscription,
        Streaming(chain.port, chain.probe, 0.05),
    ):
        for message in subscription:
            if isinstance(message, Pose):
                assert message.number == last + 1
                last = message.number
            elif isinstance(message, Status) and last and said is None:
                said = message.quality["number"]
            # It may come before the poses that it knows of, or after others.
            if said is not None and last >= said > 0:
                break
        assert subscription.missed == Missed()


def test_a_daemon_that_is_killed_and_started_again_is_heard_again(
    chain: Chain, tmp_path: Path
) -> None:
    with subscribe(endpoint=chain.daemon.endpoint) as subscription:
        start(chain, subscription)
        chain.daemon.process.kill()
        chain.daemon.process.wait()
        again = DaemonProcess(
            chain.port.path,
            directory=tmp_path,
            log=False,
            endpoint=chain.daemon.endpoint,
        )
        hello = Streaming(
            chain.port, chain.probe, 0.5, lambda: chain.probe.say("hello")
        )
        with chain.daemon, hello:
            chain.daemon = again
            again.expect("found on")
        before = subscription.missed
        while subscription.missed.daemon_restarts == 0:
            start(chain, subscription)
        assert before.daemon_restarts == 0
        assert subscription.missed.daemon_restarts == 1


def test_marks_and_states_of_bodies_come_to_who_wants_them(tmp_path: Path) -> None:
    segment = {"name": "thigh", "parent": None, "presence": "ok", "q": POSE["q"]}
    state = {"type": "body", "body": "leg", "side": "right", "number": 1, "t_ns": 5}
    state |= {"t_bound_us": None, "stage": "running", "says": None, "missing": []}
    state |= {"segments": [segment], "joints": []}
    with (
        running(tmp_path, "") as (daemon, probe, _),
        subscribe(topics=("mark", "body"), endpoint=daemon.endpoint) as told,
        Client(daemon.endpoint) as client,
    ):
        while (mark := told.get(0.2)) is None:
            client.command(probe.name, "mark", value="0.42", unit="N")
        assert isinstance(mark, Mark)
        assert (mark.probe, mark.value, mark.unit) == (probe.name, 0.42, "N")
        client.session.put("imud/body/leg/state", json.dumps(state))
        while isinstance(body := next(told), Mark):
            pass
        assert isinstance(body, Body)
        assert (body.body, body.segments[0].q) == ("leg", POSE["q"])
