# SPDX-License-Identifier: MIT
"""The RN-41's driver with a module that is slow, silent, noisy or stubborn."""

from __future__ import annotations

import random

import pytest

from core.rn41_desk import FACTORY, RIGHT, SECOND_US, Module, Probe, kinds, lib

pytestmark = pytest.mark.sampled(2)


def test_a_module_that_starts_slowly_is_found_all_the_same():
    module = Module()
    probe = Probe(module)
    module.is_mute = True
    probe.run(2.5)
    module.is_mute = False
    assert probe.run_to(lib.RN41_WAITING) < 5
    assert module.resets == 1


def test_a_module_that_never_answers_is_a_fault_told_once_and_tried_for_ever():
    module = Module()
    module.is_mute = True
    probe = Probe(module)
    assert probe.run_to(lib.RN41_FAILED) < 60
    probe.run(180)
    assert kinds(probe) == [lib.RN41_FAULT]
    assert probe.rn41.fault == lib.RN41_SILENT
    assert 6 <= module.resets <= 9
    assert probe.rn41.resets == module.resets - 1
    assert not lib.rn41_carries(probe.rn41)
    module.is_mute = False
    assert probe.run_to(lib.RN41_WAITING) < 60
    assert probe.rn41.fault == lib.RN41_NO_FAULT


@pytest.mark.parametrize("noise", [b"", b"\x00\xff", b"x" * 300, b"D\rE\r\n=\n=0\n"])
def test_noise_in_place_of_answers_is_a_fault_and_never_a_write(noise):
    module = Module(FACTORY | {"SU": "921K"})
    module.noise = lambda answer: answer if answer.startswith(b"CMD") else noise
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_GARBLED
    assert module.writes == []


@pytest.mark.parametrize("answer", [b"ERROR:(0)\r\n", b"+NAME:HC-05\r\n", b"$$$"])
def test_another_module_in_its_place_is_a_fault_and_never_a_write(answer):
    module = Module()
    module.noise = lambda _: answer
    probe = Probe(module)
    assert probe.run_to(lib.RN41_FAILED) < 60
    assert module.writes == []
    module.noise = lambda theirs: theirs
    assert probe.run_to(lib.RN41_WAITING) < 60


def test_noise_in_front_of_an_answer_is_borne():
    module = Module(FACTORY)
    module.noise = lambda answer: (
        b"\xfe\x80" + answer if answer[:1] in b"ACR" else answer
    )
    probe = Probe(module)
    assert probe.run_to(lib.RN41_WAITING) < 14


def test_a_list_that_never_ends_is_a_fault():
    module = Module()
    probe = Probe(module)
    module.noise = lambda answer: (
        answer + b"=" * 400_000 if b"BTA" in answer else answer
    )
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_GARBLED


def test_a_setting_that_is_not_kept_is_a_fault_and_is_written_four_times_at_most():
    module = Module(RIGHT | {"ST": "60"})
    module.keeps = lambda name: name != "ST"
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    probe.run(600)
    assert probe.rn41.fault == lib.RN41_REFUSED
    assert module.writes == ["ST,0"] * 4
    assert kinds(probe) == [lib.RN41_FAULT]


def test_a_setting_that_is_not_taken_is_a_fault():
    module = Module(FACTORY)
    module.noise = lambda answer: b"ERR\r\n" if answer == b"AOK\r\n" else answer
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_REFUSED


def test_without_end_it_is_not_taken_for_data_mode():
    module = Module()
    module.noise = lambda answer: b"" if answer == b"END\r\n" else answer
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_SILENT
    assert lib.RN41_WAITING not in probe.states


def test_a_restart_whose_answer_is_cut_short_counts():
    module = Module(FACTORY)
    module.noise = lambda answer: answer.replace(b"Reboot!\r\n", b"Reb")
    probe = Probe(module)
    assert probe.run_to(lib.RN41_WAITING) < 14
    assert module.reboots == 1


def test_a_module_that_is_plugged_in_late_is_set_up():
    module = Module(FACTORY)
    module.is_there = False
    probe = Probe(module).run(20)
    assert probe.rn41.state == lib.RN41_CABLE
    module.is_there = True
    module.boot()
    probe.run_to(lib.RN41_WAITING)
    assert module.stored == RIGHT


def test_a_module_that_is_there_and_linked_after_each_reset_is_served():
    module = Module()
    module.is_mute = True
    probe = Probe(module)
    probe.run(3)
    while probe.rn41.phase != 0:  # held in reset once more
        probe.step()
    module.is_there = False  # reads high, as linked at once
    probe.run(5)
    assert kinds(probe) == [lib.RN41_LINKED]


def test_the_clock_may_wrap_at_any_time():
    for before_us in range(0, 14_000_000, 700_000):
        probe = Probe(Module(FACTORY), start_us=2**32 - before_us)
        assert probe.run_to(lib.RN41_WAITING) < 14
        assert len(probe.module.writes) == 3


def test_resets_stop_counting_at_the_top():
    module = Module()
    module.is_mute = True
    probe = Probe(module)
    probe.rn41.resets = 65534
    probe.run(120)
    assert probe.rn41.resets == 65535


@pytest.mark.parametrize("seed", range(20))
def test_damage_at_random_is_borne_until_it_ends(seed):
    chance = random.Random(seed)  # noqa: S311, no secret
    module = Module(FACTORY)
    probe = Probe(module)
    quiet_us = 100 * SECOND_US

    def noise(answer: bytes) -> bytes:
        if module.now_us > quiet_us or chance.random() < 0.6:
            return answer
        damaged = bytearray(answer)
        damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
        return bytes(damaged[: chance.randrange(len(damaged) + 1)])

    module.noise = noise
    probe.run(100)
    probe.run_to(lib.RN41_WAITING, seconds=120)
    assert module.stored == RIGHT
