# SPDX-License-Identifier: MIT
"""Any file at all, to all that reads logs: read, or one line that says why not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer

from imud import cli
from imud.log.parts import seal
from imud.log.reader import FRAME_ENCODING
from imud.recordings import replay
from length import choose, examples
from log_files import records, write

pytestmark = pytest.mark.sampled(2)

CASES = choose(everyday=40, long=200)

COMMANDS = (
    ["info", "{}"],
    ["info", "--json", "{}"],
    ["recover", "{}", "--to", "{}.saved"],
    ["export", "{}", "--to", "csv", "--out", "{}.tables"],
    ["export", "{}", "--to", "parquet", "--out", "{}.tables"],
    ["replay", "{}", "--speed", "max"],
    ["decode", "{}"],
    ["decode", "--json", "{}"],
)


class Nowhere:
    """A port that takes all at once."""

    name = "nowhere"

    def __init__(self, _: object) -> None: ...
    def wait_open(self) -> None: ...
    def write(self, _: bytes) -> None: ...
    def drain(self) -> int:
        return 0

    def close(self) -> None: ...


@pytest.fixture(autouse=True)
def no_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "PtyPort", Nowhere)


def check(path: Path, case: int, capsys: pytest.CaptureFixture[str]) -> int:
    """A command ends well, or with one line; its exit code."""
    words = COMMANDS[case % len(COMMANDS)]
    code = cli.main([word.format(path) for word in words])
    captured = capsys.readouterr()
    assert code in (0, 1), (words, captured.err)
    if code == 1:
        *counts, last = captured.err.splitlines()
        assert last.startswith("imud: "), captured.err
        assert words[0] == "decode" or not counts, captured.err
    return code


def tidy(folder: Path) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_cut_and_struck_logs_end_in_one_line_at_worst(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], seed: int
) -> None:
    put = records(40)
    whole = write(tmp_path / "in", put[:20], put[20:]).read_bytes()
    folder = tmp_path / "out"
    folder.mkdir()
    found = set()
    state = seed
    for case in range(CASES // 4):
        # Each command meets each kind of damage.
        struck = bytearray(whole)
        for _ in range(case % 8):
            state = (state * 1664525 + 1013904223) % 2**32
            struck[state % len(whole)] = state >> 24
        if case % 3:
            state = (state * 1664525 + 1013904223) % 2**32
            del struck[state % len(whole) :]
        path = folder / "any.mcap"
        path.write_bytes(struck)
        found.add(check(path, case, capsys))
        tidy(folder)
    assert found == {0, 1}


json = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=4), inner)
    ),
    max_leaves=6,
)
keys = st.sampled_from(
    [
        *("t_ns", "seq", "q", "flags", "acc_m_s2", "gyr_counts", "detail", "event"),
        *("state", "port", "ledger", "clock", "counters", "compared", "step_ns"),
    ]
)
objects = st.dictionaries(keys, json)
texts = st.text(max_size=12)
topics = st.sampled_from(
    ["pose", "raw", "event", "status", "twin", "clock", "log", "frame", "pose_in_frame"]
)
names = st.one_of(
    st.builds(
        lambda prefix, probe, topic: f"{prefix}/{probe}/{topic}", texts, texts, topics
    ),
    texts,
)
contents = objects.map(lambda value: repr(value).encode()) | st.binary(max_size=40)


@st.composite
def messages(draw: st.DrawFn) -> tuple[str, bytes, int]:
    import msgspec

    data = draw(objects.map(msgspec.json.encode) | contents)
    return draw(names), data, draw(st.integers(0, 2**64 - 1))


metadata = st.tuples(
    st.sampled_from(["imud", "hello", "configuration", "other"]),
    st.dictionaries(
        st.sampled_from(["version", "schema_fingerprint", "probe", "content"]), texts
    ),
)


@pytest.mark.long
@settings(
    max_examples=examples(2 * CASES),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    case=st.integers(0, len(COMMANDS) - 1),
    written=st.lists(messages(), max_size=6),
    about=st.lists(metadata, max_size=3),
)
def test_logs_of_others_end_in_one_line_at_worst(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    case: int,
    written: list[tuple[str, bytes, int]],
    about: list[tuple[str, dict[str, str]]],
) -> None:
    """Whole MCAP files, whose channels and messages are none of ours."""
    folder = tmp_path / "out"
    folder.mkdir(exist_ok=True)
    path = folder / "other.mcap"
    with path.open("wb") as file:
        writer: Any = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="", library="other")
        for name, words in about:
            writer.add_metadata(name, seal(name, words))
        for name, data, t_ns in written:
            channel = writer.register_channel(name, FRAME_ENCODING, 0)
            writer.add_message(channel, t_ns, data, t_ns)
        writer.finish()
    check(path, case, capsys)
    tidy(folder)
