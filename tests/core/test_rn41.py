# SPDX-License-Identifier: MIT
"""The RN-41's driver with a module of its guide: set-up, links, who connects when."""

from __future__ import annotations

import pytest

from core.rn41_desk import (
    FACTORY,
    NAME,
    RIGHT,
    SECOND_US,
    Module,
    Probe,
    ffi,
    kinds,
    lib,
)


@pytest.mark.parametrize(
    ("tail", "name"), [(b"\x0e\x5f", NAME), (b"\xa9\x90", "imu-probe-a990")]
)
def test_the_name_ends_as_the_id_does(tail, name):
    out = ffi.new("char[]", lib.RN41_NAME_SIZE)
    lib.rn41_name(out, bytes(6) + tail)
    assert ffi.string(out).decode() == name


def test_where_nothing_is_wired_the_wire_is_a_cable_and_not_a_byte_is_said():
    module = Module()
    module.is_there = False
    probe = Probe(module)
    assert not lib.rn41_carries(probe.rn41)
    probe.run(30)
    assert probe.states == [lib.RN41_LOOKING, lib.RN41_CABLE]
    assert lib.rn41_carries(probe.rn41)
    assert (module.sent, probe.events) == ([], [])


def test_a_cables_bytes_are_never_taken_by_the_driver():
    module = Module()
    probe = Probe(module)
    module.is_there = False
    module.to_driver.append((0, 921600, b"CMD\r\nEND\r\n"))
    probe.run(2)
    assert probe.received == b"CMD\r\nEND\r\n"


def test_a_right_module_is_set_up_without_a_write():
    probe = Probe(Module())
    took = probe.run_to(lib.RN41_WAITING)
    assert took < 4
    assert (probe.module.writes, probe.module.reboots) == ([], 0)
    assert [text for _, text in probe.module.sent] == ["$$$", "D\r", "E\r", "---\r"]
    assert (probe.rn41.resets, probe.rn41.fault) == (0, lib.RN41_NO_FAULT)
    assert not probe.module.is_commanding
    assert not lib.rn41_carries(probe.rn41)


def test_a_module_from_the_factory_is_corrected_once_and_restarted_once():
    probe = Probe(Module(FACTORY))
    assert probe.run_to(lib.RN41_WAITING) < 14
    assert probe.module.writes == [f"SN,{NAME}", "SU,921K", "ST,0"]
    assert probe.module.reboots == 1
    assert probe.module.stored == RIGHT
    probe.run(60)
    assert len(probe.module.writes) == 3
    again = Probe(probe.module)
    again.run_to(lib.RN41_WAITING)
    assert len(probe.module.writes) == 3


@pytest.mark.parametrize(
    ("setting", "value", "written"),
    [
        ("SN", "imu-probe-0e5", f"SN,{NAME}"),
        ("SN", NAME + "0", f"SN,{NAME}"),
        ("SM", "Auto", "SM,0"),
        ("ST", "255", "ST,0"),
        ("SU", "115K", "SU,921K"),
    ],
)
def test_only_what_differs_is_written(setting, value, written):
    probe = Probe(Module(RIGHT | {setting: value}))
    probe.run_to(lib.RN41_WAITING)
    assert probe.module.writes == [written]
    assert probe.module.stored == RIGHT


def test_any_other_name_can_be_given_and_twenty_characters_count():
    probe = Probe(Module(RIGHT), name="a name of more than 20 characters")
    probe.run_to(lib.RN41_WAITING)
    assert probe.module.writes == ["SN,a name of more than "]


def test_silence_surrounds_each_entry_into_command_mode():
    probe = Probe(Module(FACTORY))
    probe.run_to(lib.RN41_WAITING)
    sent = probe.module.sent
    entries = [index for index, (_, text) in enumerate(sent) if text == "$$$"]
    assert len(entries) == len(probe.module.gaps_us) == 3
    for index in entries:
        assert sent[index + 1][0] - sent[index][0] >= SECOND_US
    assert min(probe.module.gaps_us) >= SECOND_US


def test_links_come_and_go_and_each_is_told():
    module = Module()
    module.link_at = [(8_000_000, True), (12_000_000, False), (15_000_000, True)]
    probe = Probe(module).run(20)
    linked, dropped = lib.RN41_LINKED, lib.RN41_DROPPED
    assert kinds(probe) == [linked, dropped, linked]
    assert [round(at / SECOND_US, 1) for at, _ in probe.events] == [8.0, 12.0, 15.0]
    assert lib.rn41_carries(probe.rn41)
    assert module.resets == 1


def test_a_blink_of_the_pin_is_no_link():
    module = Module()
    module.link_at = [(8_000_000, True), (8_010_000, False)]
    assert kinds(Probe(module).run(10)) == []


def test_what_a_host_sends_is_never_swallowed_even_right_behind_end():
    module = Module()
    sent = bytes(range(256)) * 2
    probe = Probe(module)
    while "---\r" not in [text for _, text in module.sent]:
        probe.step()
    module.is_linked = True
    module.to_driver.append((module.now_us, 921600, sent))
    probe.run(2)
    assert probe.received == sent
    assert kinds(probe) == [lib.RN41_LINKED]


def test_no_answer_reaches_who_reads_the_wire():
    module = Module(FACTORY)
    module.link_at = [(25_000_000, True)]
    probe = Probe(module).run(30)
    assert kinds(probe) == [lib.RN41_LINKED]
    assert probe.received == b""


def test_dollars_as_data_never_lead_into_command_mode_once_set_up():
    module = Module(FACTORY)
    probe = Probe(module)
    probe.run_to(lib.RN41_WAITING)
    module.link_at = [(module.now_us, True)]
    probe.run(3)
    module.on_send(ffi.from_buffer(b"$$$"), 3)
    probe.run(3)
    assert not module.is_commanding
    assert module.to_host == b"$$$"


def test_who_connects_before_the_settings_are_known_is_sent_away_and_comes_back():
    module = Module(FACTORY)
    module.host_after_us = 2_000_000
    probe = Probe(module)
    probe.run_to(lib.RN41_CONNECTED)
    assert module.stored == RIGHT
    assert kinds(probe) == [lib.RN41_LINKED]
    assert module.to_host == b""


def test_who_comes_at_once_each_time_is_served_and_the_settings_are_looked_at_later():
    module = Module(RIGHT | {"SN": "imu-probe-0000"})
    module.host_after_us = 50_000
    probe = Probe(module)
    probe.run_to(lib.RN41_CONNECTED)
    assert (module.resets, probe.rn41.resets) == (4, 3)
    assert module.to_host == b""
    probe.run(5)
    module.host_after_us = None
    module.is_linked = False
    probe.run_to(lib.RN41_WAITING)
    assert module.writes == [f"SN,{NAME}"]
    assert kinds(probe) == [lib.RN41_LINKED, lib.RN41_DROPPED]
    assert probe.rn41.early_peers == 0  # the next start sends as many away again


def test_who_connects_while_command_mode_is_asked_for_is_sent_away():
    module = Module(FACTORY)
    module.is_mute = True
    probe = Probe(module)
    probe.run(1.6)  # $$$ has been sent, and nothing has come
    assert module.resets == 1
    module.is_linked = True
    probe.run(2)
    assert (module.resets, kinds(probe)) == (2, [])


def test_a_right_module_keeps_a_host_that_comes_quickly():
    module = Module()
    module.answers_after_us = 100_000
    module.host_after_us = 600_000
    probe = Probe(module)
    probe.run_to(lib.RN41_CONNECTED)
    assert (module.resets, module.to_host) == (1, b"")
