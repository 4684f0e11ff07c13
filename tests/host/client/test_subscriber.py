# SPDX-License-Identifier: MIT
"""`subscribe` with a daemon: what arrives, and what a subscriber is told it missed."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fakes import POSE, DaemonProcess, FakeProbe, Port
from imud.client import (
    Event,
    Missed,
    Pose,
    Raw,
    Status,
    Subscription,
    Topic,
    subscribe,
)


class Chain:
    """A fake probe that a daemon has found."""

    def __init__(self, directory: Path) -> None:
        self.probe = FakeProbe()
        self.port = Port(directory / "port")
        self.daemon = DaemonProcess(self.port.path, directory=directory, log=False)
        self.find()

    def find(self) -> None:
        self.daemon.expect("listens on")
        self.port.wait_open()
        with self.speaking("hello", every_s=0.5):
            self.daemon.expect("found on")

    def start(self, subscription: Subscription[Any]) -> Any:
        """Says poses until one comes: from there on all do."""
        with self.speaking("pose"):
            return next(subscription)

    @contextlib.contextmanager
    def speaking(self, name: str, every_s: float = 0.05) -> Iterator[None]:
        ended = threading.Event()

        def speak() -> None:
            while not ended.wait(every_s):
                self.port.write(self.probe.say(name))

        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            yield
        finally:
            ended.set()
            speaker.join()

    def close(self) -> None:
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


@pytest.fixture
def chain(tmp_path: Path) -> Iterator[Chain]:
    made = Chain(tmp_path)
    yield made
    made.close()


def test_all_kinds_come_typed(chain: Chain) -> None:
    topics: tuple[Topic, ...] = ("pose", "raw", "event", "status")
    with subscribe(topics=topics, endpoint=chain.daemon.endpoint) as subscription:
        chain.start(subscription)
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
        chain.start(early)
        chain.port.write(chain.probe.poses(50))
        last = chain.probe.sequence - 1
        while (pose := next(early)).seq < last:
            pass
        with subscribe(endpoint=chain.daemon.endpoint, history=20) as late:
            before = [next(late).number for _ in range(20)]
            assert before == list(range(pose.number - 19, pose.number + 1))
            assert chain.start(late).number == pose.number + 1
            assert late.missed == Missed()


def test_a_status_says_the_number_of_the_last_pose(chain: Chain) -> None:
    topics: tuple[Topic, ...] = ("pose", "status")
    last, said = 0, None
    with (
        subscribe(topics=topics, endpoint=chain.daemon.endpoint) as subscription,
        chain.speaking("pose"),
    ):
        for message in subscription:
            if isinstance(message, Pose):
                assert message.number == last + 1
                last = message.number
            elif isinstance(message, Status) and last and said is None:
                # On a busy machine it may come before the poses that it knows of.
                said = message.quality["number"]
                assert said >= last
            if last == said:
                break
        assert subscription.missed == Missed()


def test_a_daemon_that_is_killed_and_started_again_is_heard_again(
    chain: Chain, tmp_path: Path
) -> None:
    with subscribe(endpoint=chain.daemon.endpoint) as subscription:
        chain.start(subscription)
        first = chain.daemon
        first.process.kill()
        first.process.wait()
        again = DaemonProcess(
            chain.port.path, directory=tmp_path, log=False, endpoint=first.endpoint
        )
        with first:
            chain.daemon = again
            chain.find()
        before = subscription.missed
        while subscription.missed.daemon_restarts == 0:
            chain.start(subscription)
        assert before.daemon_restarts == 0
        assert subscription.missed.daemon_restarts == 1
