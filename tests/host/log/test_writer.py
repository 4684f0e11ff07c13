# SPDX-License-Identifier: MIT
"""The writer of logs makes the same files as the mcap library's own, to the byte."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from imud.log.writer import CHUNK_MAX, LogWriter

START_NS = 1_800_000_000_000_000_000


def fill(writer: Any, flushes: int, most: int, seed: int) -> None:
    """Some of all that a log has; `most` bytes a message."""
    chance = random.Random(seed)  # noqa: S311 - no secret
    writer.add_metadata("imud", {"version": "1", "b": "ä"})
    schema = writer.register_schema("imud.pose", "jsonschema", b"{}")
    channels = [
        writer.register_channel("imud/p/pose", "json", schema),
        writer.register_channel("imud/p/frame", "x-imud-frame", 0),
        writer.register_channel("imud/p/never", "json", schema),
    ]
    time_ns = START_NS
    for number in range(flushes):
        for _ in range(chance.randint(0, 40)):
            # Not quite in order, as arrivals are.
            time_ns += chance.randint(-1000, 5_000_000)
            data = chance.randbytes(chance.randint(0, most))
            channel = chance.choice(channels[:2])
            writer.add_message(channel, time_ns, data, time_ns - 3000, number)
        if number == flushes // 2:
            writer.add_metadata("hello", {"probe": "p"})
        writer.flush()
    writer.finish()


@pytest.mark.parametrize("flushes", [0, 1, 30])
@pytest.mark.parametrize("seed", range(3))
def test_files_are_those_of_the_library(
    tmp_path: Path, flushes: int, seed: int
) -> None:
    ours, theirs = tmp_path / "ours.mcap", tmp_path / "theirs.mcap"
    with ours.open("wb") as file:
        fill(LogWriter(file, "imud 1"), flushes, 500, seed)
    with theirs.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="imud 1")
        fill(writer, flushes, 500, seed)
    assert ours.read_bytes() == theirs.read_bytes()


def test_a_chunk_ends_before_it_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        fill(LogWriter(file, "imud 1"), 10, 200_000, seed=1)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        times = [message.log_time for _, _, message in reader.iter_messages()]
    assert len(times) == summary.statistics.message_count
    assert times == sorted(times)
    assert len(summary.chunk_indexes) > 10
    assert max(c.uncompressed_size for c in summary.chunk_indexes) < CHUNK_MAX + 200_100
