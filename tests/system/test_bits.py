# SPDX-License-Identifier: MIT
"""Promise 1, the same bits everywhere: one raw log, one hash of its poses on every
processor.

The log comes from a whole image. Its raw samples go through the core alone on each
processor, because two boards with two sensors have no sample in common.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from bits.processors import PROCESSORS, computed, has_sensor, replayed
from fakes import FakeProbe
from fakes.records import any_records, parts_of
from imud.virtual import motion, sensors
from imud.wire import schema
from imud.wire.messages import Message, decode, encode
from imud.wire.params import digest_of
from length import choose
from system.virtual import BOARDS, Run, Stub, assert_nothing_is_lost, run, send

pytestmark = pytest.mark.sampled(4)

# `make bits` takes ten minutes of recordings.
SECONDS = float(os.environ.get("IMU_BITS_SECONDS", choose(everyday=8, long=62)))
# As everywhere, the FPU, which images leave off, is for `make test-long`.
NAMES = choose(everyday=["atmega328p", "cortex_m4"], long=[*PROCESSORS])
RECORDINGS = Path(__file__).resolve().parents[3] / "shared" / "data" / "broad"

# How long random params are in force.
PARAMS_US = 1_000_000

# While it moves: an origin, a heading alone, a restarted filter.
CHANGES = (
    ("tare", 0, 3_500_000),
    ("tare", 1, 4_000_000),
    ("restart", 0, 5_000_000),
    ("tare", 1, 6_000_000),
    ("tare", 2, 7_000_000),
)


def write_movement(path: Path) -> Path:
    """Recorded, trial after trial, or a hand's where there are no recordings."""
    pieces: list[motion.Motion] = []
    for recording in sorted(RECORDINGS.glob("*.npz")):
        if sum(piece.seconds for piece in pieces) < SECONDS:
            pieces.append(motion.load(recording))
    if not pieces:
        pieces = [sensors.generate(SECONDS, seed=3)]
    with path.open("wb") as file:
        motion.write_stream(file, pieces)
    return path


@pytest.fixture(scope="module", params=BOARDS)
def log(
    request: pytest.FixtureRequest,
    boards: dict[str, tuple[Path, Path]],
    tmp_path_factory: pytest.TempPathFactory,
) -> Run:
    name = request.param
    stub = Stub(BOARDS[name], *boards[name], tmp_path_factory.mktemp("bits"))
    options: list[object] = ["--motion", write_movement(stub.folder / "movement")]
    options += ["--press", "200000:300000", *stub.raw_too]
    for token, (command, argument, at_us) in enumerate(CHANGES, start=8):
        options += ["--send", f"{at_us}:{send(command, argument, token=token)}"]
    done = run(stub, SECONDS, *options)
    assert_nothing_is_lost(done)
    told = [event for event, cause in done.events if cause == "command"]
    assert told == ["tared", "tared", "restarted", "tared", "tared"]
    return done


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("processor", [*NAMES, "host"])
def test_a_log_of_poses_has_one_hash_on_every_processor(
    log: Run, processor: str, tmp_path: Path
) -> None:
    both = zip(log.contents, log.messages, strict=True)
    reference = [content for content, message in both if message.name == "pose"]
    assert len(reference) > 100 * (SECONDS - 2)
    poses = computed(processor, log.contents, tmp_path)
    first = next((n for n, p in enumerate(poses) if p != reference[n]), None)
    assert first is None, f"pose {first} of {len(reference)} differs"
    assert poses == reference


def under_params(
    contents: Sequence[bytes], seed: int, filters: Sequence[int]
) -> list[bytes]:
    """The log of a probe with random params, which change every second: a filter, each
    of `filters` in turn, then starts with them.
    """
    changed: list[bytes] = []
    is_begun = False
    due_us = 0
    for content in contents:
        message = decode(content)
        assert isinstance(message, Message)
        at = message.sequence, message.time_us
        if not is_begun and has_sensor(content):
            records = any_records(seed)
            fields = {**message.fields, "params_digest": digest_of(records)}
            changed += params_messages(records, *at)
            changed.append(encode("hello", fields, *at))
            is_begun, due_us = True, message.time_us + PARAMS_US
            continue
        if is_begun and message.name == "raw" and message.time_us >= due_us:
            seed += 1
            records = any_records(seed)
            detail = digest_of(records) - ((digest_of(records) >> 31) << 32)
            changed += params_messages(records, *at)
            kind = filters[seed % len(filters)]
            for event, number in (("params_changed", detail), ("restarted", kind)):
                values = {"event": event, "cause": "command", "detail": number}
                changed.append(encode("event", values, *at))
            due_us += PARAMS_US
        changed.append(content)
    return changed


def params_messages(records: bytes, sequence: int, time_us: int) -> Iterator[bytes]:
    return parts_of(
        FakeProbe(),
        records,
        lambda name, **values: encode(name, values, sequence, time_us),
    )


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("processor", NAMES)
def test_any_params_and_filter_give_one_hash_on_every_processor(
    log: Run, processor: str, tmp_path: Path
) -> None:
    # A Nano has room for one filter.
    filters = [1] if processor == "atmega328p" else [*schema.Filter][1:]
    contents = under_params(log.contents, len(log.contents), filters)
    reference, plain = list(replayed(contents)), list(replayed(log.contents))
    assert len(plain) == len(reference)
    assert plain != reference
    poses = computed(processor, contents, tmp_path)
    first = next((n for n, p in enumerate(poses) if p != reference[n]), None)
    assert first is None, f"pose {first} of {len(reference)} differs"
    assert poses == reference
