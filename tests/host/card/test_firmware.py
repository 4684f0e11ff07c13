# SPDX-License-Identifier: MIT
"""The card that `imud card prepare` makes and the firmware's own driver: it finds the
log, and what it keeps there `imud card read` brings back, also after a cut."""

from __future__ import annotations

from pathlib import Path

import pytest

import native
from core.fake_card import FakeCard
from core.log_desk import LOST_US_MAX, SECOND, Log
from fakes import FakeProbe
from imud import cli
from imud.log.reader import Logged
from imud.wire.frame import encode_frame
from length import choose
from log_files import read_log

pytestmark = pytest.mark.sampled(3)

MIB = 1 << 20
BLOCK = 512

ffi, lib = native.load()


def inserted(path: Path, size: int) -> FakeCard:
    """A card with all that the image holds; what is not there is zero."""
    assert cli.main(["card", "prepare", str(path), "--size", str(size)]) == 0
    card = FakeCard(size // BLOCK)
    with path.open("rb") as file:
        for number in range(36 * MIB // BLOCK):  # to behind the log's head
            data = file.read(BLOCK)
            if any(data):
                card.content[number] = data
    return card


def taken_out(card: FakeCard, path: Path) -> None:
    with path.open("r+b") as file:
        for number, data in card.content.items():
            file.seek(number * BLOCK)
            file.write(data)


def record(log: Log, probe: FakeProbe, us: float) -> list[tuple[float, bytes]]:
    """Raw and pose at 380 Hz, a hello first; when each was handed over."""
    log.open()
    probe.sequence = 0
    kept = []
    until = at = log.now_us
    until += us
    names = ["hello"]
    while log.now_us < until:
        while at <= log.now_us:
            for name in (*names, "raw", "pose"):
                content = probe.content(name)
                assert log.keep(encode_frame(content))
                kept.append((log.now_us, content))
            names = []
            at += SECOND / 380
        log.step(max(at - log.now_us, 1))
    return kept


def read_back(path: Path, to: Path) -> dict[int, list[bytes]]:
    assert cli.main(["card", "read", str(path), "--to", str(to)]) == 0
    found = {}
    for log in to.glob("card-*.mcap"):
        items = [item for item in read_log(log) if isinstance(item, Logged)]
        frames = [item.data for item in items if item.topic == "frame"]
        found[int(log.stem.rsplit("-", 1)[1])] = frames
    return found


@pytest.mark.parametrize("size", [34 * MIB, 2048 * MIB, 65536 * MIB])
def test_the_firmware_logs_on_a_prepared_card_and_all_of_it_comes_back(
    tmp_path: Path, size: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "card.img"
    card = inserted(path, size)
    log = Log(card).until("ready", 60 * SECOND)
    recorded = []
    for _ in range(2):
        recorded.append(
            [content for _, content in record(log, FakeProbe(), 2 * SECOND)]
        )
        log.close()
    taken_out(card, path)
    capsys.readouterr()
    assert read_back(path, tmp_path) == {1: recorded[0], 2: recorded[1]}
    assert capsys.readouterr().out.count("0 lost, ended cleanly: ") == 2


@pytest.mark.long
@pytest.mark.parametrize("seed", range(choose(everyday=3, long=12)))
def test_after_a_cut_all_but_half_a_second_comes_back_and_the_next_one_whole(
    tmp_path: Path, seed: int
) -> None:
    path = tmp_path / "card.img"
    card = inserted(path, 34 * MIB)
    card.random.seed(seed)
    if seed % 3 == 0:
        card.busy_us = lambda block: 250_000 if block % 97 == 0 else 100
    log = Log(card).until("ready")
    cut = record(log, FakeProbe(), SECOND + seed * 7919 % 100_000)
    for _ in range(seed):
        log.step()
    cut_us = log.now_us
    card.cut()
    card.power_up()
    after = Log(card).until("ready")
    whole = [content for _, content in record(after, FakeProbe(), SECOND)]
    after.close()
    taken_out(card, path)
    found = read_back(path, tmp_path)
    assert found[2] == whole
    assert found[1] == [content for _, content in cut[: len(found[1])]]
    assert all(cut_us - us < LOST_US_MAX for us, _ in cut[len(found[1]) :])
