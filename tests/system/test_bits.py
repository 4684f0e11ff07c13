# SPDX-License-Identifier: MIT
"""Promise 1, the same bits everywhere: one raw log, one hash of its poses on every
processor."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

from imud import _core
from system.virtual import (
    FIELDS_ALL,
    Run,
    Stub,
    assert_nothing_is_lost,
    run,
    send,
    write_hand,
)

SECONDS = 62

# While a hand moves it: an origin, a heading alone, a filter that begins anew.
CHANGES = (
    ("tare", 0, 11_000_000),
    ("tare", 1, 21_000_000),
    ("restart", 0, 31_000_000),
    ("tare", 1, 41_000_000),
    ("tare", 2, 51_000_000),
)


def sent(log: Run) -> list[bytes]:
    """The poses of the image, computed by an ATmega328P."""
    both = zip(log.contents, log.messages, strict=True)
    return [content for content, message in both if message.name == "pose"]


def replayed(log: Run) -> list[bytes]:
    """The poses of the host's build of the same C."""
    poses = []
    replay: _core.Replay | None = None
    for content, message in zip(log.contents, log.messages, strict=True):
        if message.name == "hello" and message.fields["sample_rate"] and replay is None:
            replay = _core.Replay(content)
        if replay is None:
            continue
        if message.name == "raw":
            replay.step(content)
        elif message.name == "pose":
            poses.append(replay.pose(message.sequence, message.time_us))
        elif message.fields.get("event") in ("tared", "restarted"):
            change = {"tared": replay.origin, "restarted": replay.restart}
            detail = message.fields["detail"]
            assert isinstance(detail, int)
            change[str(message.fields["event"])](detail)
    return poses


PROCESSORS: dict[str, Callable[[Run], list[bytes]]] = {
    "atmega328p": sent,
    "host": replayed,
}


@pytest.fixture(scope="module")
def log(nano: Path, image: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    stub = Stub(nano, image, tmp_path_factory.mktemp("bits"))
    hand = write_hand(stub.folder / "hand", SECONDS)
    options: list[object] = ["--motion", hand, "--press", "200000:300000"]
    options += ["--send", f"320000:{FIELDS_ALL}"]
    for token, (name, argument, at_us) in enumerate(CHANGES, start=8):
        options += ["--send", f"{at_us}:{send(name, argument, token=token)}"]
    done = run(stub, SECONDS, *options)
    assert_nothing_is_lost(done)
    told = [event for event, cause in done.events if cause == "command"]
    assert told == ["tared", "tared", "restarted", "tared", "tared"]
    return done


@pytest.mark.parametrize("processor", PROCESSORS)
def test_a_minute_of_poses_has_one_hash_on_every_processor(
    log: Run, processor: str
) -> None:
    poses, reference = PROCESSORS[processor](log), sent(log)
    first = next((n for n, p in enumerate(poses) if p != reference[n]), None)
    assert first is None, f"pose {first} of {len(reference)} differs"
    assert len(reference) > 6000
    assert digest(poses) == digest(reference)


def digest(poses: list[bytes]) -> str:
    return hashlib.sha256(b"".join(poses)).hexdigest()
