# SPDX-License-Identifier: MIT
"""The virtual pyboard without use of the module: raw samples, and poses by the host."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fakes import PATIENCE_S, DaemonProcess
from imud import _core
from imud.client import Client
from imud.config.settings import Config, ProbeSettings
from imud.stages import InjectMessage
from imud.stages.fusion import FusionStage
from imud.wire import schema
from imud.wire.messages import Message, decode
from sessions import received
from streaming import until
from system.live import LiveProbe, hear, take
from system.virtual import (
    MICROPYTHON,
    Run,
    Stub,
    assert_nothing_is_lost,
    run,
    write_hand,
)

pytestmark = pytest.mark.long

SECONDS = 20


def moved(stub: Stub) -> Run:
    """A hand moves it while it streams poses and all raw samples."""
    hand = write_hand(stub.folder / "hand", SECONDS)
    words = ("--motion", hand, "--press", "200000:300000", *stub.raw_too)
    return run(stub, SECONDS, *words)


@pytest.fixture(scope="module")
def plain(
    f405: Path, plain_image: Path, tmp_path_factory: pytest.TempPathFactory
) -> Run:
    """The same board and hand without the module."""
    folder = tmp_path_factory.mktemp("plain")
    return moved(Stub(MICROPYTHON, f405, plain_image, folder))


def fused(done: Run) -> list[Message]:
    """The poses that the daemon computes from what the board sent."""
    events = received(done.contents)
    settings = ProbeSettings(fuse_on_host=True)
    stage = FusionStage(Config(probes={events[0].probe_id: settings}))
    outcomes = [outcome for event in events for outcome in stage.on_message(event)]
    added = [
        decode(each.content) for each in outcomes if isinstance(each, InjectMessage)
    ]
    messages = [message for message in added if isinstance(message, Message)]
    return [message for message in messages if message.name == "pose"]


def quaternions(poses: list[Message]) -> dict[int, np.ndarray]:
    """By hundredths of a second."""
    return {p.time_us // 10_000: np.array(p.fields["q"]) for p in poses}


def test_without_the_module_the_host_computes_the_same_poses(
    f405: Path, micropython_image: Path, plain: Run, tmp_path: Path
) -> None:
    stub = Stub(MICROPYTHON, f405, micropython_image, tmp_path)
    poses = quaternions(fused(plain))
    reference = quaternions(moved(stub).named("pose"))
    late = 100 * (SECONDS - 2)
    both = sorted(at for at in poses.keys() & reference.keys() if at > late)
    assert len(both) > 100
    cosines = [abs(float(poses[at] @ reference[at])) for at in both]
    assert np.degrees(2 * np.arccos(np.clip(min(cosines), 0, 1))) < 5


def test_without_the_module_no_sample_is_lost(plain: Run) -> None:
    times = np.array([raw.time_us for raw in plain.named("raw")])
    assert len(times) > 370 * (SECONDS - 2)
    assert np.all(np.rint(np.diff(times) * 380e-6) == 1)
    assert_nothing_is_lost(plain)


def test_its_seconds_are_seconds(plain: Run) -> None:
    times = [status.time_us for status in plain.named("status")]
    assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(1e6, abs=1000)


def test_a_board_without_the_module_has_poses_at_a_subscriber(
    f405: Path, plain_image: Path, tmp_path: Path
) -> None:
    stub = Stub(MICROPYTHON, f405, plain_image, tmp_path)
    name = run(stub, 0.5).named("hello")[0].fields["probe_id"]
    assert isinstance(name, bytes)
    config = tmp_path / "imud.toml"
    config.write_text(f"[probes.{name.hex()}]\nfuse_on_host = true\n")
    probe = LiveProbe(stub, "--press", "200000:300000")
    with DaemonProcess(probe.port, "--config", config, directory=tmp_path) as daemon:
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            client.wait_for(seconds=PATIENCE_S)
            poses = take(hear(client, "pose"), 60)
            # A status is up to a second old.
            until(lambda: client.statuses()[0]["fusion"]["is_on_host"])
            (status,) = client.statuses()
        probe.end()
        daemon.stop()
    numbers = [pose["number"] for pose in poses]
    assert numbers == list(range(numbers[0], numbers[0] + 60))
    assert status["fusion"]["is_on_host"]
    assert status["ledger"]["lost"] == 0


def test_a_filter_in_floats_loses_no_sample_and_follows_that_of_core(
    root: Path, f405: Path, plain_image: Path, tmp_path: Path
) -> None:
    source = root / "tests" / "micropython" / "mains" / "madgwick.py"
    words = (sys.executable, "tools/micropython_build.py", source)
    subprocess.run(words, cwd=root, check=True)
    done = moved(Stub(MICROPYTHON, f405, plain_image.with_name("madgwick"), tmp_path))
    assert_nothing_is_lost(done)
    assert done.named("hello")[-1].fields["filter"] == "madgwick"
    events = [name for name, _ in done.events]
    assert "calibration_done" in events
    assert "overrun" not in events
    replay = None
    apart = []
    for content, message in zip(done.contents, done.messages, strict=True):
        if replay is None and message.fields.get("sample_rate"):
            replay = _core.Replay(content, b"")
            replay.restart(int(schema.Filter.MADGWICK))
        elif replay is not None and message.name == "raw":
            replay.step(content)
        elif replay is not None and message.name == "pose":
            theirs = decode(replay.pose(message.sequence, message.time_us))
            assert isinstance(theirs, Message)
            a, b = (np.array(each.fields["q"]) for each in (message, theirs))
            apart.append(np.degrees(2 * np.arccos(min(1.0, abs(float(a @ b))))))
    assert len(apart) > 90 * (SECONDS - 2)
    # Fewer steps, and another bias: the raw stream began after some samples.
    assert max(apart) < 6
