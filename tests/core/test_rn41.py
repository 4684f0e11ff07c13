# SPDX-License-Identifier: MIT
"""The RN-41's driver against a module made of the user's guide: command mode between
silences, answers, lists, settings that count from the next start."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest

import native

ffi, lib = native.load()

STEP_US = 5000
BOOT_US = 400_000
SECOND_US = 1_000_000
NAME = "imu-probe-0e5f"
RIGHT = {"SN": NAME, "SU": "921K", "SM": "Slav", "ST": "0"}
FACTORY = {"SN": "FireFly-AB12", "SU": "115K", "SM": "Slav", "ST": "60"}
BAUDS = {"92": 921600, "11": 115200}
MODES = {"0": "Slav", "3": "Auto"}


class Module:
    """An RN-41, and the pins between it and the driver."""

    def __init__(self, settings: dict[str, str] | None = None) -> None:
        self.stored = dict(RIGHT if settings is None else settings)
        self.now_us = 0
        self.is_there = True
        self.is_mute = False
        self.answers_after_us = SECOND_US  # with CMD
        self.host_after_us: int | None = None  # connects each time, after a start
        self.link_at: list[tuple[int, bool]] = []
        self.host_sends: list[tuple[int, bytes]] = []
        self.is_linked = False
        self.keeps = lambda _name: True  # settings that it writes to its flash
        self.noise: Callable[[bytes], bytes] = lambda said: said
        self.writes: list[str] = []
        self.reboots = self.resets = 0
        self.is_in_reset = False
        self.is_commanding = False
        self.line_baud = 0
        self.to_driver: deque[tuple[int, int, bytes]] = deque()
        self.taken = 0  # bytes of its first
        self.sent: list[tuple[int, str]] = []  # by the driver, as it meant it
        self.gaps_us: list[int] = []  # before each $$$; a start counts as silence
        self.to_host = b""  # what reached who is connected
        self.boot()

    def boot(self) -> None:
        self.ready_us = self.now_us + BOOT_US
        self.settings = dict(self.stored)
        self.started_us = self.now_us
        self.heard_us = self.now_us - 10 * SECOND_US
        self.escape_us: int | None = None
        self.typed = ""
        self.is_commanding = self.is_linked = False

    @property
    def baud(self) -> int:
        return BAUDS[self.settings["SU"][:2]]

    @property
    def level(self) -> bool:
        """PIO2."""
        is_driven = self.is_there and not self.is_in_reset
        return self.is_linked if is_driven and self.now_us >= self.ready_us else True

    def say(self, text: str) -> None:
        if self.baud != self.line_baud:
            text = "\x80\xfe" * (len(text) // 2)
        self.to_driver.append(
            (self.now_us + 3000, self.line_baud, self.noise(text.encode("latin-1")))
        )

    def may_command(self) -> bool:
        timer = int(self.settings["ST"])
        is_early = self.now_us - self.started_us < timer * SECOND_US
        return is_early or timer >= 253 or not self.is_linked

    # The driver's side.

    def on_send(self, text: Any, length: int) -> None:
        data = bytes(ffi.buffer(text, length)).decode("latin-1")
        self.sent.append((self.now_us, data))
        if not self.is_there or self.is_in_reset or self.now_us < self.ready_us:
            return
        if data == "$$$":
            self.gaps_us.append(self.now_us - self.heard_us)
        if self.baud != self.line_baud:
            data = "\xff" * length
        for byte in data:
            self.take(byte)

    def take(self, byte: str) -> None:
        is_after_silence = self.now_us - self.heard_us >= SECOND_US
        self.heard_us = self.now_us
        if self.is_commanding:
            if byte == "\r":
                self.obey(self.typed)
                self.typed = ""
            else:
                self.typed += byte
            return
        if self.is_linked:
            self.to_host += byte.encode("latin-1")
        self.typed = byte if is_after_silence else self.typed + byte
        self.escape_us = self.now_us if self.typed == "$$$" else None

    def obey(self, command: str) -> None:
        name, _, value = command.partition(",")
        if command == "---":
            self.is_commanding = False
            self.say("END\r\n")
        elif command == "D":
            self.say(
                "***Settings***\r\nBTA=000666AB1234\r\n"
                f"BTName={self.stored['SN']}\r\nBaudrt(SW4)={self.stored['SU']}\r\n"
                f"Mode  ={self.stored['SM']}\r\nAuthen=1\r\n"
                "Bonded=0\r\nRem=NONE SET\r\n"
            )
        elif command == "E":
            self.say(
                "***ADVANCED Settings***\r\nSrvName= SPP\r\nSrvClass=0000\r\n"
                f"CfgTimer={self.stored['ST']}\r\nStatuStr=NULL\r\n"
            )
        elif command == "R,1":
            self.say("Reboot!\r\n")
            self.reboots += 1
            self.boot()
        elif name in self.stored and value:
            self.writes.append(command)
            if self.keeps(name):
                self.stored[name] = MODES[value] if name == "SM" else value
            self.say("AOK\r\n")
        else:
            self.say("?\r\n")

    def on_receive(self) -> int:
        if self.to_driver and self.to_driver[0][0] <= self.now_us:
            _, baud, data = self.to_driver[0]
            self.taken += 1
            if self.taken <= len(data):
                return data[self.taken - 1] if baud == self.line_baud else 0
            self.to_driver.popleft()
            self.taken = 0
            return self.on_receive()
        return -1

    def on_baud(self, baud: int) -> None:
        self.line_baud = baud

    def on_reset(self, is_held: bool) -> None:
        self.resets += is_held and not self.is_in_reset
        if self.is_in_reset and not is_held:
            self.to_driver.clear()
            self.taken = 0
            self.boot()
        self.is_in_reset = is_held

    # The rest of the world.

    def pass_time(self, us: int) -> None:
        self.now_us += us
        if self.is_there and not self.is_in_reset and self.now_us >= self.ready_us:
            host_us = self.host_after_us
            if host_us is not None and self.now_us - self.ready_us >= host_us:
                self.is_linked = True
            while self.link_at and self.link_at[0][0] <= self.now_us:
                self.is_linked = self.link_at.pop(0)[1]
            while self.host_sends and self.host_sends[0][0] <= self.now_us:
                _, data = self.host_sends.pop(0)
                self.to_driver.append((self.now_us, self.line_baud, data))
            if (
                self.escape_us is not None
                and self.now_us - self.escape_us >= self.answers_after_us
                and self.may_command()
                and not self.is_mute
            ):
                self.escape_us, self.typed = None, ""
                self.is_commanding = True
                self.say("CMD\r\n")


class Probe:
    """The driver, and what the probe does beside it."""

    def __init__(self, module: Module, name: str = NAME, start_us: int = 0) -> None:
        self.module = module
        self.received = b""
        self.events: list[tuple[int, int]] = []
        self.states: list[int] = []
        module.now_us = start_us
        module.boot()
        port = {
            "send": ffi.callback("void(char *, uint8_t)", module.on_send),
            "receive": ffi.callback("int16_t(void)", module.on_receive),
            "set_baud": ffi.callback("void(uint32_t)", module.on_baud),
            "is_linked": ffi.callback("bool(void)", lambda: module.level),
            "hold_reset": ffi.callback("void(bool)", module.on_reset),
        }
        self.port = ffi.new("struct rn41_port *", port)
        self._keep = port
        self.rn41 = ffi.new("struct rn41 *")
        self.text = ffi.new("char[]", name.encode())
        lib.rn41_begin(self.rn41, self.port, self.text, start_us & 0xFFFFFFFF)
        self.note()

    def note(self) -> None:
        if not self.states or self.states[-1] != self.rn41.state:
            self.states.append(self.rn41.state)

    def step(self, us: int = STEP_US) -> None:
        module = self.module
        module.pass_time(us)
        event = lib.rn41_step(self.rn41, module.now_us & 0xFFFFFFFF)
        if event != lib.RN41_NOTHING:
            self.events.append((module.now_us, event))
        self.note()
        if self.rn41.state not in (lib.RN41_CONFIGURING, lib.RN41_FAILED):
            while (byte := module.on_receive()) >= 0:
                self.received += bytes([byte])

    def run(self, seconds: float) -> Probe:
        until = self.module.now_us + int(seconds * SECOND_US)
        while self.module.now_us < until:
            self.step()
        return self

    def run_to(self, state: int, seconds: float = 60) -> float:
        """Return after how many seconds the state was reached."""
        begun = self.module.now_us
        while self.rn41.state != state:
            assert self.module.now_us - begun < seconds * SECOND_US
            self.step()
        return (self.module.now_us - begun) / SECOND_US


def kinds(probe: Probe) -> list[int]:
    return [event for _, event in probe.events]


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
    module.noise = lambda said: said if said.startswith(b"CMD") else noise
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_GARBLED
    assert module.writes == []


def test_noise_in_front_of_an_answer_is_borne():
    module = Module(FACTORY)
    module.noise = lambda said: b"\xfe\x80" + said if said[:1] in b"ACR" else said
    probe = Probe(module)
    assert probe.run_to(lib.RN41_WAITING) < 14


def test_a_list_that_never_ends_is_a_fault():
    module = Module()
    probe = Probe(module)
    module.noise = lambda said: said + b"=" * 400_000 if b"BTA" in said else said
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
    module.noise = lambda said: b"ERR\r\n" if said == b"AOK\r\n" else said
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_REFUSED


def test_without_end_it_is_not_taken_for_data_mode():
    module = Module()
    module.noise = lambda said: b"" if said == b"END\r\n" else said
    probe = Probe(module)
    probe.run_to(lib.RN41_FAILED)
    assert probe.rn41.fault == lib.RN41_SILENT
    assert lib.RN41_WAITING not in probe.states


def test_a_restart_whose_answer_is_cut_short_counts():
    module = Module(FACTORY)
    module.noise = lambda said: said.replace(b"Reboot!\r\n", b"Reb")
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

    def noise(said: bytes) -> bytes:
        if module.now_us > quiet_us or chance.random() < 0.6:
            return said
        damaged = bytearray(said)
        damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
        return bytes(damaged[: chance.randrange(len(damaged) + 1)])

    module.noise = noise
    probe.run(100)
    probe.run_to(lib.RN41_WAITING, seconds=120)
    assert module.stored == RIGHT
