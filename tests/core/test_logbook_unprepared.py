# SPDX-License-Identifier: MIT
"""Cards that are unprepared or inconsistent: nothing is written outside the file."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.fake_card import BLOCK
from core.log_desk import SECOND, Log, Volume, lib
from length import choose

pytestmark = pytest.mark.sampled(3)


def unprepared(volume: Volume) -> None:
    card = volume.card()
    log = Log(card).until("unprepared")
    assert log.changes == [("card_fault", "unprepared", 0)]
    assert not lib.logbook_open(log.book)
    log.run(2 * SECOND)
    assert log.changes == [("card_fault", "unprepared", 0)]
    assert not card.runs


@pytest.mark.parametrize(
    ("at", "value"),
    [
        (510, 0),
        (511, 0),
        (450, 0x07),
        (454, 0),  # start: in the table itself
        (457, 0xFF),  # beyond the card
        (461, 0xFF),  # longer than the card
    ],
)
def test_a_partition_table_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    table = bytearray(volume.content[0])
    table[at] = value
    volume.content[0] = bytes(table)
    unprepared(volume)


@pytest.mark.parametrize(
    ("at", "value"),
    [
        *((510, 0), (511, 0), (11, 1), (12, 4), (13, 0), (13, 3), (13, 255)),
        *((14, 0), (15, 0xFF), (16, 0), (16, 3), (17, 1), (19, 1), (22, 1)),
        *((32, 0), (35, 1), (36, 0), (39, 1), (40, 0x80), (42, 1)),
        *((44, 0), (44, 1), (46, 1), (47, 0x10)),
    ],
)
def test_a_volume_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    boot = bytearray(volume.content[volume.start])
    boot[at] = value
    volume.content[volume.start] = bytes(boot)
    unprepared(volume)


def test_one_reserved_block_is_enough_for_the_volume_itself():
    Log(Volume(reserved=1).card()).until("ready")


@pytest.mark.parametrize(
    ("blocks", "fat_blocks", "is_enough"),
    # 256 entries fill two blocks, 257 need a third.
    [(500, 2, True), (500, 1, False), (502, 3, True), (502, 2, False)],
)
def test_a_fat_has_an_entry_for_each_cluster_and_two(blocks, fat_blocks, is_enough):
    volume = Volume(blocks, fat_blocks=fat_blocks)
    assert volume.clusters + 2 == (256 if blocks == 500 else 257)
    if is_enough:
        Log(volume.card()).until("ready")
    else:
        unprepared(volume)


@pytest.mark.parametrize(
    ("at", "value"),
    [
        *((0, ord("Q")), (0, 0xE5), (0, 0), (11, 0x10), (11, 0x08), (11, 0x0F)),
        *((20, 1), (21, 1), (26, 0), (26, 1), (26, 2), (26, 4), (27, 1)),
        *((28, 1), (29, 0), (30, 9), (31, 0xFF)),
    ],
)
def test_an_entry_that_makes_no_sense_is_refused(at, value):
    volume = Volume()
    block = bytearray(volume.content[volume.block_of(2)])
    block[3 * 32 + at] = value
    volume.content[volume.block_of(2)] = bytes(block)
    unprepared(volume)


@pytest.mark.parametrize("link", [0, 3, 0x0FFFFFF7, 0x0FFFFFFF])
@pytest.mark.parametrize("at", [0, 1, 124, 125, 126, 198, 199])
def test_a_file_in_pieces_is_refused(at, link):
    volume = Volume()
    if at == 199 and link == 0x0FFFFFFF:
        link = 1  # its end is to be there
    volume.links[volume.first + at] = link
    volume.write_links()
    unprepared(volume)


def test_the_upper_bits_of_a_link_mean_nothing():
    volume = Volume()
    volume.links = [link | 0xA0000000 for link in volume.links]
    volume.write_links()
    Log(volume.card()).until("ready")


@pytest.mark.parametrize("link", [0, 1, 2, 0x0FFFFFF7, 0x0FFFFFFF])
def test_a_root_folder_that_leads_nowhere_is_refused(link):
    volume = Volume(others=40)
    volume.links[2] = link  # of 2: to itself, for ever
    volume.write_links()
    unprepared(volume)


@pytest.mark.parametrize(
    "changed",
    [
        *({"version": 2}, {"size": 1024}, {"card_id": 0}, {"lba": 1}),
        *({"blocks": 399}, {"blocks": 401}, {"rest": 1}),
    ],
)
def test_a_head_that_is_not_of_this_file_is_refused(changed):
    volume = Volume()
    volume.content[volume.file] = volume.head(**changed)
    unprepared(volume)
    volume.content[volume.file] = bytes(BLOCK)
    unprepared(volume)


@pytest.mark.long
@settings(max_examples=choose(everyday=20, long=200))
@given(st.data())
def test_rubbish_never_lets_it_write_beyond_the_file(data):
    volume = Volume(300, cluster=data.draw(st.sampled_from([1, 4])), others=20)
    parts = (0, volume.start, volume.start + 4, volume.block_of(2), volume.file)
    places = (
        [*range(440, 512)],
        [*range(64)],
        [*range(512)],
        [*range(512)],
        [*range(40)],
    )
    for _ in range(data.draw(st.integers(1, 4))):
        which = data.draw(st.integers(0, 4))
        block = bytearray(volume.content[parts[which]])
        block[data.draw(st.sampled_from(places[which]))] = data.draw(
            st.integers(0, 255)
        )
        volume.content[parts[which]] = bytes(block)
    card = volume.card()
    before = dict(card.content)
    log = Log(card)
    while log.state == "starting":
        log.step()
        assert log.now_us < 10 * SECOND
    if log.state == "ready":
        log.open().log(300_000).close()
    inside = range(volume.file + 1, volume.file + volume.blocks)
    changed = {at for at in card.content if card.content[at] != before.get(at)}
    assert changed <= {*inside}


@pytest.mark.parametrize("sane", range(3))
@pytest.mark.parametrize("seed", range(20))
def test_a_card_of_noise_is_refused(seed, sane):
    noise = random.Random(seed)  # noqa: S311, no secret
    volume = Volume(20)
    kept = [0, volume.start][:sane]
    card = volume.card()
    for at in range(card.size):
        if at not in kept:
            card.content[at] = noise.randbytes(BLOCK)
    log = Log(card)
    while log.state == "starting":
        log.step()
    assert log.state == "unprepared"
