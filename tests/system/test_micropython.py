# SPDX-License-Identifier: MIT
"""The virtual pyboard: MicroPython with the module imuprobe and the package inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bits.processors import replayed
from fakes import PATIENCE_S, DaemonProcess
from imud.client import Client
from imud.config.settings import Config, ProbeSettings
from imud.stages import Adds
from imud.stages.fusion import FusionStage
from imud.wire.messages import Message, decode
from length import choose
from sessions import received
from system.live import LiveProbe, hear, take
from system.virtual import (
    MICROPYTHON,
    Run,
    Stub,
    assert_nothing_is_lost,
    run,
    send,
    write_hand,
)

CLICK = ("--press", "200000:300000")
SECONDS = choose(everyday=5, long=62)


@pytest.fixture
def stub(f405: Path, micropython_image: Path, tmp_path: Path) -> Stub:
    return Stub(MICROPYTHON, f405, micropython_image, tmp_path)


def moved(stub: Stub, *options: object) -> Run:
    """A hand moves it while it streams poses and all raw samples."""
    hand = write_hand(stub.folder / "hand", SECONDS)
    return run(stub, SECONDS, "--motion", hand, *CLICK, *stub.raw_too, *options)


@pytest.mark.long
def test_its_poses_are_in_every_bit_those_of_the_native_core(stub: Stub) -> None:
    done = moved(stub, "--send", f"3500000:{send('tare', 1, token=9)}")
    assert_nothing_is_lost(done)
    poses = [content for content in done.contents if content[0] == 0x06]
    assert len(poses) > 100 * (SECONDS - 2)
    assert poses == list(replayed(done.contents))


def test_its_hello_tells_micropython_and_its_version(stub: Stub) -> None:
    hello = run(stub, 2).named("hello")[-1].fields
    assert str(hello["firmware"]).startswith("mpy 1.")
    assert str(hello["firmware"]).endswith(" pyboard")
    assert hello["reset_cause"] == ("power_on",)


def test_it_has_the_id_of_the_c_firmware(stub: Stub, f405_image: Path) -> None:
    other = Stub(stub.board, stub.simulator, f405_image, stub.folder)
    ids = {run(each, 1).named("hello")[0].fields["probe_id"] for each in (stub, other)}
    assert len(ids) == 1


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
    outcomes = [outcome for event in events for outcome in stage.take(event)]
    added = [decode(each.content) for each in outcomes if isinstance(each, Adds)]
    return [message for message in added if isinstance(message, Message)]


def quaternions(poses: list[Message]) -> dict[int, np.ndarray]:
    """By hundredths of a second."""
    return {p.time_us // 10_000: np.array(p.fields["q"]) for p in poses}


def test_without_the_module_the_host_computes_the_same_poses(
    stub: Stub, plain: Run
) -> None:
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
            (status,) = client.statuses()
        probe.end()
        daemon.stop()
    numbers = [pose["number"] for pose in poses]
    assert numbers == list(range(numbers[0], numbers[0] + 60))
    assert status["fusion"]["is_on_host"]
    assert status["ledger"]["lost"] == 0
