# SPDX-License-Identifier: MIT
"""A damaged card costs the damaged blocks and no more."""

from __future__ import annotations

import errno
import os
import re
import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from card_files import (
    SMALL,
    Taped,
    bare,
    block_of,
    blocks_of,
    contents_of,
    frames_of,
    laid,
    lines_of,
    log_of,
    logs_in,
    prepared,
    run,
    sealed,
    tape,
    with_log,
)
from fakes import FakeProbe
from imud.card import disk
from imud.card.disk import Disk
from imud.card.probe_log import find_log
from imud.errors import FileError
from imud.wire.messages import decode
from length import examples

kinds = st.sampled_from(["torn", "rubbish", "stale", "zero"])
damage = st.lists(st.tuples(st.integers(0, 400), kinds), max_size=6)


def hurt(blocks: list[bytes], damages: list[tuple[int, str]]) -> set[int]:
    """Damages blocks in place; which of them are bad after it."""
    bad = set()
    for place, kind in damages:
        index = place % len(blocks)
        block = blocks[index]
        if kind == "torn":  # the power went while it was written
            block = block[: place % 512] + b"\xff" * (512 - place % 512)
        elif kind == "rubbish":
            block = bytes((byte * 7 + place) & 0xFF for byte in block)
        elif kind == "stale":  # of this place, from before the card was prepared again
            head = (0x777).to_bytes(4, "little")
            block = sealed(head + block[4:508])
        else:
            block = bytes(512)
        if block != blocks[index]:
            blocks[index] = block
            bad.add(index)
    return bad


@settings(
    max_examples=examples(60),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    counts=st.lists(st.integers(0, 120), min_size=1, max_size=4),
    flushed=st.sets(st.integers(0, 120), max_size=10),
    damages=damage,
    is_cut=st.booleans(),
    cut=st.integers(0, 40),
    behind=st.sampled_from(["nothing", "stale", "rubbish"]),
)
def test_all_but_the_damaged_blocks_comes_back_message_by_message(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    counts: list[int],
    flushed: set[int],
    damages: list[tuple[int, str]],
    is_cut: bool,
    cut: int,
    behind: str,
) -> None:
    probe = FakeProbe()
    tapes = [tape(contents_of(probe, count), flushed=flushed) for count in counts]
    blocks = laid(tapes, 0x1234)
    starts = [0]
    for each in tapes:
        starts.append(starts[-1] + len(each.payloads))
    bad = hurt(blocks, damages)
    if is_cut:
        kept = max(0, len(blocks) - cut)
        bad |= set(range(kept, len(blocks)))
        blocks[kept:] = [bytes(512)] * (len(blocks) - kept)
    if behind == "stale":
        blocks += [
            block_of(0x777, len(blocks) + 1 + n, 3, 0, b"\x05old\0") for n in range(9)
        ]
    elif behind == "rubbish":
        blocks += [bytes([n % 251 for n in range(k, k + 512)]) for k in range(9)]
    folder = tmp_path / "logs"
    shutil.rmtree(folder, ignore_errors=True)
    assert run("read", bare(tmp_path, blocks), "--to", folder) == 0
    logs = logs_in(folder)
    lines = lines_of(capsys)
    for number, (start, each) in enumerate(zip(starts, tapes, strict=False), 1):
        kept_messages = [
            message
            for message in each.messages
            if not any(start + block in bad for block in message.blocks)
        ]
        if not kept_messages:
            assert number not in logs
            continue
        assert frames_of(logs[number]) == [message.content for message in kept_messages]
        first, last = (
            decode(kept_messages[index].content).sequence for index in (0, -1)
        )
        assert first is not None
        (line,) = [each for each in lines if each.startswith(f"recording {number}: ")]
        # Each number up to the last that came is received or lost.
        assert (
            f"{last + 1} sent = {len(kept_messages)} received + 0 skewed + "
            f"{last + 1 - len(kept_messages)} lost" in line
        )
        has_last = starts[number] - 1 not in bad
        assert ("ended cleanly" if has_last else "cut off") in line
        assert ("its first block is lost" in line) is (start in bad)


def test_a_place_that_was_cut_and_written_again_belongs_to_who_wrote_it(
    tmp_path: Path,
) -> None:
    """A cut spoilt block 5 of a run; the next recording continues there, and what the
    card had written behind it is still the first one's."""
    first, second = (contents_of(FakeProbe(), count) for count in (120, 20))
    old = laid([tape(first, is_ended=False)], 0x1234)
    new = laid([Taped([b""] * 4, []), tape(second)], 0x1234)[4:]
    assert len(new) < len(old) - 4
    path = bare(tmp_path, old[:4] + new + old[4 + len(new) :])
    run("read", path, "--to", tmp_path)
    logs = logs_in(tmp_path)
    assert frames_of(logs[2]) == second
    gone = range(4, 4 + len(new))
    assert frames_of(logs[1]) == [
        message.content
        for message in tape(first).messages
        if not any(block in gone for block in message.blocks)
    ]


def test_a_block_that_was_written_twice_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A card says that it failed and has kept the block: its bytes come again."""
    each = tape(contents_of(FakeProbe(), 300))
    each.payloads.insert(10, each.payloads[10])
    path = bare(tmp_path, laid([each], 0x1234))
    run("list", path)
    assert re.split(r"  +", lines_of(capsys)[2])[4] == "0 of 301"
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [
        message.content for message in each.messages
    ]
    told = lines_of(capsys)[1]
    assert "301 sent = 301 received + 0 skewed + 0 lost" in told
    assert re.search(r", \d+ duplicated, 1 frame torn, ended cleanly", told)


def test_worn_places_are_stepped_over_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = blocks_of([FakeProbe()], 0x1234, 1500)
    for index in (*range(10, 18), 30, *range(40, 60)):
        blocks[index] = b"\xa5" * 512
    run("list", bare(tmp_path, blocks))
    summary, _, row = lines_of(capsys)
    assert summary.endswith(", 29 torn or worn")
    assert row.split("  ")[-2:] == ["29 blocks", "ended cleanly"]


@pytest.mark.parametrize("left_out", [0, 2])
def test_blocks_that_the_probe_counted_and_the_card_lost_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], left_out: int
) -> None:
    probe = FakeProbe()
    contents = contents_of(probe, 300)
    for block in range(left_out):
        worn = {"event": "card_fault", "cause": "worn", "detail": 10 + block}
        contents.append(probe.content("event", **worn))
    contents.append(probe.content("equipment", card_block=20))
    blocks = laid([tape(contents)], 0x1234)
    for index in (9, 10, 11):  # a counterfeit's
        blocks[index] = bytes(512)
    run("list", bare(tmp_path, blocks))
    counted = "3 blocks" if left_out == 0 else "1 block"
    assert lines_of(capsys)[-1].startswith(
        f"recording 1: the probe counted {counted} more than the card kept"
    )


def test_a_card_prepared_anew_shows_nothing_of_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    before = log_of(path)
    assert run("prepare", path, "--yes") == 0
    # The blocks are all still there: what makes them no good is the card's id alone.
    assert log_of(path)[512:] == before[512:]
    assert any(before[512:])
    capsys.readouterr()
    assert run("list", path) == 0
    (line,) = lines_of(capsys)
    assert ": 0 recordings, 0 of " in line
    assert run("read", path, "--to", tmp_path) == 0
    assert logs_in(tmp_path) == {}


def test_a_place_that_can_not_be_read_costs_that_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    each = tape(contents_of(FakeProbe(), 800))
    path = bare(tmp_path, laid([each], 0x1234))
    unreadable = (11, 12, 40)
    real = Disk.read_at

    def read_at(self: Disk, offset: int, size: int) -> bytes:
        if any(offset < (n + 1) * 512 and n * 512 < offset + size for n in unreadable):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return real(self, offset, size)

    monkeypatch.setattr(Disk, "read_at", read_at)
    run("read", path, "--to", tmp_path)
    assert frames_of(logs_in(tmp_path)[1]) == [
        message.content
        for message in each.messages
        if not any(block + 1 in unreadable for block in message.blocks)
    ]


def test_a_file_moved_by_a_computer_is_not_read_as_if_it_were_in_one_piece(
    tmp_path: Path,
) -> None:
    path = with_log(prepared(tmp_path / "card.img"), blocks_of([FakeProbe()]))
    fat = path.read_bytes().index(b"\xf8\xff\xff\x0f")  # how each FAT begins
    cluster = 60_000  # one of the log's
    with path.open("r+b") as file:
        file.seek(fat + 4 * cluster)
        assert int.from_bytes(file.read(4), "little") == cluster + 1
        file.seek(fat + 4 * cluster)
        file.write((cluster + 7).to_bytes(4, "little"))
    with disk.opened(path) as image, pytest.raises(FileError, match="is fragmented"):
        find_log(image)


@settings(
    max_examples=examples(60),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    flips=st.lists(
        st.tuples(st.integers(0, 700 * 512), st.integers(0, 255)),
        min_size=1,
        max_size=30,
    )
)
def test_a_damaged_file_system_is_one_clear_line(
    tmp_path: Path, flips: list[tuple[int, int]]
) -> None:
    pristine = tmp_path / "pristine.img"
    if not pristine.exists():
        prepared(pristine, SMALL)
    path = tmp_path / "card.img"
    shutil.copyfile(pristine, path)
    with path.open("r+b") as file:
        for place, byte in flips:
            # Mostly where it hurts: table, boot sector, folder.
            volume = (0, 128 * 512, 128 * 512 + 1152 * 512)[place % 3]
            file.seek(volume + place // 3 % 512)
            file.write(bytes([byte]))
    with disk.opened(path) as image:
        try:
            log = find_log(image)
        except FileError as error:
            assert "\n" not in str(error)
        else:
            assert log.recordings() == []
