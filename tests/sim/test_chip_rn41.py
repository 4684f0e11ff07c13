# SPDX-License-Identifier: MIT
"""The model of the RN-41 against the manufacturer's documents.

Words and numbers are typed from the user's guide (RN-BT-DATA-UG 1.0r), the manual of
firmware 4.77 and the data sheet (DS50002280B), not taken from the model.
"""

from __future__ import annotations

import itertools
from typing import Any

import pytest

import chips
from length import choose

MS = 1_000_000
SECOND = 1000 * MS
FACTORY = 115_200
UP = 1.0  # s from power-up until it is ready
LINK = 3.0  # until a host is there

ffi, lib = chips.load("rn41", core=False)


class Radio:
    """A module, the time, a UART and a host."""

    def __init__(self, settings: str = "", **config: int) -> None:
        self.config = ffi.new("struct rn41_chip_config *")
        self.config[0] = lib.rn41_chip_defaults()
        for name, value in config.items():
            setattr(self.config, name, value)
        self.chip = ffi.gc(lib.rn41_chip_new(self.config), lib.rn41_chip_free)
        if settings:
            assert lib.rn41_chip_load(self.chip, settings.encode())
        self.now = 0
        self.baud = FACTORY
        self.said = b""
        self.heard = b""
        self.rates: set[int] = set()

    def until(self, seconds: float) -> None:
        self.now = max(self.now, round(seconds * SECOND))
        lib.rn41_chip_advance(self.chip, self.now)
        self.collect()

    def wait(self, seconds: float) -> None:
        self.until(self.now / SECOND + seconds)

    def collect(self) -> None:
        byte, baud = ffi.new("uint8_t *"), ffi.new("uint32_t *")
        while lib.rn41_chip_take(self.chip, byte, baud):
            self.said += bytes([byte[0]])
            self.rates.add(baud[0])
        while lib.rn41_chip_host_read(self.chip, byte):
            self.heard += bytes([byte[0]])

    def send(self, data: bytes) -> None:
        """Back to back, at the rate of this side."""
        for byte in data:
            self.now += 10 * SECOND // self.baud
            lib.rn41_chip_receive(self.chip, self.now, byte, self.baud)
            self.collect()

    def ask(self, line: str, seconds: float = 0.2) -> str:
        self.said = b""
        self.send(line.encode() + b"\r")
        self.wait(seconds)
        return self.said.decode()

    def command(self, at: float = UP + 0.1) -> None:
        """Into command mode."""
        self.until(at)
        self.send(b"$$$")
        self.wait(0.2)
        assert self.said.endswith(b"CMD\r\n")

    def host(self, data: bytes) -> None:
        for byte in data:
            lib.rn41_chip_host_write(self.chip, self.now, byte)
        self.collect()

    def fault(self, kind: str, at: float, seconds: float = 0.0) -> None:
        fault = ffi.new("struct rn41_chip_fault *")
        fault.kind = getattr(lib, f"RN41_CHIP_{kind}")
        fault.from_ns = round(at * SECOND)
        fault.for_ns = round(seconds * SECOND)
        assert lib.rn41_chip_add_fault(self.chip, fault)

    def reset_pulse(self, ms: float) -> None:
        lib.rn41_chip_set_reset(self.chip, self.now, True)
        self.wait(ms / 1000)
        lib.rn41_chip_set_reset(self.chip, self.now, False)

    def cts(self, is_high: bool) -> None:
        lib.rn41_chip_set_cts(self.chip, self.now, is_high)
        self.collect()

    @property
    def rts(self) -> int:
        return int(lib.rn41_chip_rts(self.chip))

    @property
    def pio2(self) -> int:
        return int(lib.rn41_chip_pio2(self.chip))

    @property
    def counters(self) -> Any:
        return lib.rn41_chip_counters(self.chip)

    def complaint(self) -> str | None:
        text = lib.rn41_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()

    def settings(self) -> str:
        text = ffi.new("char[]", lib.RN41_CHIP_TEXT)
        lib.rn41_chip_save(self.chip, text)
        return str(ffi.string(text).decode())


def settings(**changes: str) -> str:
    """What a file of settings says, with some that differ from the factory's."""
    lines = dict(line.split("=", 1) for line in Radio().settings().splitlines())
    return "".join(f"{k}={v}\n" for k, v in (lines | changes).items())


def linked(text: str = "", **config: int) -> Radio:
    radio = Radio(text, **config)
    radio.until(LINK + 0.1)
    assert radio.pio2 == 1
    return radio


# Start


def test_no_pin_is_driven_until_it_is_ready() -> None:
    radio = Radio()
    for at in (0.0, 0.5, 0.999):
        radio.until(at)
        assert (radio.rts, radio.pio2) == (-1, -1)
    radio.until(UP)
    assert (radio.rts, radio.pio2) == (0, 0)


def test_a_host_connects_two_seconds_later() -> None:
    radio = Radio()
    radio.until(LINK - 0.001)
    assert radio.pio2 == 0
    radio.until(LINK)
    assert radio.pio2 == 1
    assert radio.counters.links == 1
    assert radio.said == b""  # status strings are off (UG, SO)


def test_bytes_while_it_starts_are_lost() -> None:
    radio = Radio()
    radio.send(b"abc")
    radio.until(LINK + 1)
    assert radio.heard == b""
    assert radio.counters.lost_to_host == 3


# Data


def test_data_goes_both_ways() -> None:
    radio = linked()
    sent = bytes(range(256))
    radio.send(sent)
    radio.host(sent[::-1])
    radio.wait(0.2)
    assert radio.heard == sent
    assert radio.said == sent[::-1]
    assert radio.rates == {FACTORY}
    counters = radio.counters
    assert (counters.to_host, counters.from_host) == (256, 256)
    assert (counters.lost_to_host, counters.lost_from_host) == (0, 0)


def test_without_a_host_data_is_lost_and_counted() -> None:
    radio = Radio()
    radio.until(UP + 0.5)
    radio.send(b"nobody hears this")
    radio.host(b"nor this")
    radio.until(LINK + 1)
    assert radio.heard == b""
    assert radio.said == b""
    assert radio.counters.lost_to_host == 17
    assert radio.counters.lost_from_host == 8


@pytest.mark.long
def test_240_kbit_a_second_go_through_for_long() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    start = radio.now
    sent = 0
    seconds = choose(everyday=1, long=5)
    while radio.now - start < seconds * SECOND:
        if radio.rts == 0:
            radio.send(b"x")
            sent += 1
        else:
            radio.wait(0.0001)
    assert len(radio.heard) / seconds == pytest.approx(30_000, rel=0.01)
    assert radio.counters.lost_to_host == 0
    radio.wait(1)
    assert len(radio.heard) == sent


def test_without_flow_control_what_has_no_room_falls_out() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    radio.send(b"x" * 10_000)
    radio.wait(1)
    lost = radio.counters.lost_to_host
    # 10,000 bytes come within 108.5 ms, of which the air takes 3255 and room some 2 KB.
    assert 10_000 - 3255 - 2048 - 75 <= lost <= 10_000 - 3255 - 2048 + 150
    assert len(radio.heard) == 10_000 - lost


def test_rts_rises_before_the_buffer_is_full() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    while radio.rts == 0:
        radio.send(b"x")
    # What is on its way from any UART, a FIFO of 16 bytes too, still fits.
    radio.send(b"y" * 64)
    radio.wait(1)
    assert radio.rts == 0
    assert radio.counters.lost_to_host == 0


def test_cts_holds_it_after_the_byte_under_way() -> None:
    radio = linked()
    radio.host(bytes(75))
    radio.wait(0.0026)
    radio.cts(True)
    radio.wait(0.1)
    before = len(radio.said)
    assert before <= 2
    radio.cts(False)
    radio.wait(0.1)
    assert len(radio.said) == 75


def test_a_slow_probe_holds_the_host_up_and_loses_nothing() -> None:
    radio = linked()
    radio.cts(True)
    total = 0
    while lib.rn41_chip_host_room(radio.chip) > 0:
        radio.host(b"z")
        total += 1
        radio.wait(0.0001)
    assert total >= 4000  # its own room on both sides
    radio.cts(False)
    radio.wait(2)
    assert len(radio.said) == total
    assert radio.counters.lost_from_host == 0


# Command mode


def test_three_characters_with_silence_open_command_mode() -> None:
    radio = Radio()
    radio.command()
    assert radio.said == b"CMD\r\n"
    assert radio.heard == b""


def test_bytes_within_a_second_before_make_them_data() -> None:
    radio = linked()
    radio.send(b"x")
    radio.wait(0.98)
    radio.send(b"$$$")
    radio.wait(2)
    assert radio.heard == b"x$$$"
    assert radio.said == b""
    radio.send(b"$$$")  # after silence
    radio.wait(2)
    assert radio.said == b"CMD\r\n"


@pytest.mark.parametrize("tail", [b"x", b"$"])
def test_bytes_after_make_them_data(tail: bytes) -> None:
    radio = linked(command_ns=SECOND)
    radio.send(b"$$$")
    radio.wait(0.98)
    radio.send(tail)
    radio.wait(2)
    assert radio.heard == b"$$$" + tail
    assert radio.said == b""


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_characters_are_data_a_second_later(count: int) -> None:
    radio = linked()
    radio.send(b"$" * count)
    radio.wait(0.9)
    assert radio.heard == b""
    radio.wait(0.2)
    assert radio.heard == b"$" * count


@pytest.mark.parametrize(
    ("timer", "at", "opens"),
    [
        ("0", LINK + 1, False),
        ("60", UP + 59, True),
        ("60", UP + 61, False),
        ("253", 500, True),
        ("254", LINK + 1, False),
        ("255", 500, True),
    ],
)
def test_the_timer_says_whether_while_connected(
    timer: str, at: float, opens: bool
) -> None:
    radio = linked(settings(ST=timer))
    radio.until(at)
    radio.send(b"$$$")
    radio.wait(2)
    assert (radio.said == b"CMD\r\n") is opens
    assert (radio.heard == b"$$$") is not opens


@pytest.mark.parametrize("timer", ["0", "60", "253", "254", "255"])
def test_not_connected_it_always_opens(timer: str) -> None:
    radio = Radio(settings(ST=timer), host_ns=1000 * SECOND)
    radio.command(at=200)


@pytest.mark.parametrize(("timer", "complains"), [("0", False), ("255", True)])
def test_a_host_that_can_take_it_away_is_a_complaint(
    timer: str, complains: bool
) -> None:
    radio = linked(settings(ST=timer))
    radio.host(b"$$$")
    radio.wait(2)
    assert (radio.complaint() is not None) is complains


def test_the_answers_are_the_guide_s() -> None:
    radio = Radio(host_ns=1000 * SECOND)
    radio.command()
    for line, answer in {
        "V": "Ver 6.15 04/26/2013\r\n(c) Roving Networks\r\n",
        "v": "Ver 6.15 04/26/2013\r\n(c) Roving Networks\r\n",
        "GB": "0006664F1A2C\r\n",
        "GN": "RNBT-1A2C\r\n",
        "GU": "115K\r\n",
        "GM": "Slav\r\n",
        "GA": "1\r\n",
        "GP": "1234\r\n",
        "GT": "255\r\n",
        "GO": "NULL\r\n",
        "GK": "0,0,0\r\n",
        "G$": "$\r\n",
        "": "?\r\n",
        "nonsense": "?\r\n",
        "R": "?\r\n",
        "SX": "ERR\r\n",
        "SN": "ERR\r\n",
        "SN,": "ERR\r\n",
        "SN,imu-probe-1A2C": "AOK\r\n",
        "SN," + 21 * "x": "ERR\r\n",
        "S-," + 16 * "x": "ERR\r\n",
        "SU,92": "AOK\r\n",
        "SU,77": "ERR\r\n",
        "SM,0": "AOK\r\n",
        "SM,7": "ERR\r\n",
        "SA,3": "ERR\r\n",
        "SA,4": "AOK\r\n",
        "ST,0": "AOK\r\n",
        "ST,256": "ERR\r\n",
        "ST,x": "ERR\r\n",
        "SP,0000": "AOK\r\n",
    }.items():
        assert radio.ask(line) == answer, line
    assert radio.complaint() is None
    assert radio.counters.writes == 6
    assert radio.counters.commands == 31


def test_settings_as_listed_and_used_after_a_reboot() -> None:
    radio = Radio()
    radio.command()
    assert radio.ask("D").splitlines() == [
        "***Settings***",
        "BTA=0006664F1A2C",
        "BTName=RNBT-1A2C",
        "Baudrt(SW4)=115K",
        "Mode  =Slav",
        "Authen=1",
        "PinCod=1234",
        "Bonded=0",
        "Rem=NONE SET",
    ]
    assert "CfgTimer=255" in radio.ask("E").splitlines()
    assert "CfgChar= $" in radio.ask("O").splitlines()
    assert len(radio.ask("X", 0.3).splitlines()) == 2 + 9 + 11 + 11
    radio.ask("S-,imu")
    radio.ask("SU,92")
    # Told at once, used later.
    assert radio.ask("GN") == "imu-1A2C\r\n"
    assert radio.ask("GU") == "921K\r\n"
    assert radio.ask("V").startswith("Ver")
    assert radio.ask("R,1") == "Reboot!\r\n"
    assert radio.pio2 == -1
    radio.wait(UP + 0.1)
    radio.baud = 921_600
    radio.rates.clear()
    radio.command(radio.now / SECOND)
    assert radio.rates == {921_600}
    assert radio.ask("GN") == "imu-1A2C\r\n"
    assert radio.counters.resets == 1


def test_settings_survive_in_a_file() -> None:
    radio = Radio()
    radio.command()
    for line in ("SN,imu-probe-1A2C", "SU,46", "ST,0", "SO,%", "SP,0815", "S$,#"):
        assert radio.ask(line) == "AOK\r\n"
    again = Radio(radio.settings())
    assert again.settings() == radio.settings()
    again.baud = 460_800
    again.until(UP + 0.1)
    again.send(b"###")
    again.wait(0.2)
    assert again.said == b"CMD\r\n"
    assert again.ask("GN") == "imu-probe-1A2C\r\n"


@pytest.mark.parametrize("text", ["nonsense", "SN=\n", "SQ=1\n", "SU=77\n", "SF=1\n"])
def test_a_file_of_something_else_is_refused(text: str) -> None:
    radio = Radio()
    assert not lib.rn41_chip_load(radio.chip, text.encode())


def test_factory_settings_come_back() -> None:
    radio = Radio(settings(SN="other", ST="7"))
    radio.command()
    assert radio.ask("SF,1") == "AOK\r\n"
    assert radio.settings() == settings()


def test_echo_is_switched() -> None:
    radio = Radio()
    radio.command()
    assert radio.ask("+") == "ECHO ON\r\n"
    assert radio.ask("GU") == "GU\r115K\r\n"
    assert radio.ask("+") == "+\rECHO OFF\r\n"
    assert radio.ask("GU") == "115K\r\n"


def test_end_leads_back_to_data() -> None:
    radio = Radio()
    radio.command()
    assert radio.ask("---") == "END\r\n"
    radio.until(LINK + 1)
    radio.send(b"data")
    radio.wait(0.1)
    assert radio.heard == b"data"


def test_lines_may_end_with_both() -> None:
    radio = Radio()
    radio.command()
    radio.said = b""
    radio.send(b"GU\r\n")
    radio.wait(0.2)
    radio.send(b"GT\r\n")
    radio.wait(0.2)
    assert radio.said == b"115K\r\n255\r\n"


def test_commands_wait_for_the_answer_before() -> None:
    radio = Radio()
    radio.command()
    radio.said = b""
    radio.send(b"GU\rGT\rGA\r")
    radio.wait(0.2)
    assert radio.said == b"115K\r\n255\r\n1\r\n"


def test_a_host_may_come_while_it_is_configured() -> None:
    radio = Radio()
    radio.command()
    radio.until(LINK + 0.1)
    assert radio.pio2 == 1
    assert radio.ask("GK") == "1,0,0\r\n"
    radio.host(b"lost, nobody passes it on")  # UG, T
    radio.wait(0.1)
    assert radio.ask("---") == "END\r\n"
    radio.host(b"heard")
    radio.wait(0.1)
    assert radio.said.endswith(b"END\r\nheard")
    assert radio.counters.lost_from_host == 25


def test_kill_ends_the_connection() -> None:
    radio = linked()
    radio.command(LINK + 0.5)
    assert radio.ask("K,") == "KILL\r\n"
    assert radio.pio2 == 0
    radio.wait(2.1)
    assert radio.pio2 == 1


def test_a_rate_for_now_ends_with_the_next_start() -> None:
    radio = Radio(host_ns=1000 * SECOND)
    radio.command()
    assert radio.ask("U,921K,N") == "AOK\r\n"
    radio.baud = 921_600
    radio.wait(1)
    radio.command(radio.now / SECOND)
    assert radio.ask("GU") == "115K\r\n"
    assert radio.ask("R,1") == "Reboot!\r\n"
    radio.wait(UP + 0.1)
    radio.baud = FACTORY
    radio.command(radio.now / SECOND)


def test_status_strings_come_where_they_are_set() -> None:
    radio = Radio(settings(SO="%"))
    radio.fault("DROP", LINK + 1, 1)
    radio.fault("RESET", LINK + 5)
    radio.until(20)
    lines = radio.said.decode().splitlines()
    connect = next(line for line in lines if "CONNECT" in line)
    assert connect.startswith("%CONNECT,")
    assert lines == [connect, "%DISCONNECT", connect, "%REBOOT", connect]


def test_a_long_answer_is_a_line_s_time() -> None:
    radio = Radio()
    radio.command()
    begin = radio.now
    radio.said = b""
    radio.send(b"D\r")
    while not radio.said.endswith(b"NONE SET\r\n"):
        radio.wait(0.0001)
    took = (radio.now - begin) / SECOND
    bits = 10 * (len(radio.said) + 2)
    assert took == pytest.approx(bits / FACTORY + 0.005, abs=0.0003)


# Rates


def test_another_rate_is_garbage_both_ways() -> None:
    radio = Radio()
    radio.baud = 921_600
    radio.until(UP + 0.1)
    radio.send(b"$$$")
    radio.wait(2)
    assert radio.said == b""
    radio.until(LINK + 0.1)
    radio.send(b"hello, can you hear me at all?")
    radio.wait(1)
    # Eight of those frames fall into one of its own.
    assert 0 < len(radio.heard) <= 6
    assert b"hello" not in radio.heard
    radio.baud = 9600
    heard = len(radio.heard)
    radio.send(b"slow")
    radio.wait(1)
    assert len(radio.heard) == heard + 4
    assert b"slow" not in radio.heard


@pytest.mark.parametrize(
    ("percent", "good"), [(0, True), (3.3, True), (-3.3, True), (3.4, False)]
)
def test_the_rates_may_differ_a_little(percent: float, good: bool) -> None:
    radio = linked()
    radio.baud = round(FACTORY * (1 + percent / 100))
    radio.send(bytes(range(100)))
    radio.wait(0.2)
    assert (radio.heard == bytes(range(100))) is good
    assert len(radio.heard) == 100


# Reset


def test_a_reset_pulse_starts_it_anew() -> None:
    radio = linked()
    radio.send(b"x" * 100)
    radio.reset_pulse(10)
    assert (radio.rts, radio.pio2) == (-1, -1)
    counters = radio.counters
    assert counters.resets == 1
    assert counters.to_host + counters.lost_to_host == 100
    radio.wait(0.999)
    assert radio.pio2 == -1
    radio.wait(0.002)
    assert radio.pio2 == 0
    radio.wait(2)
    assert radio.pio2 == 1
    assert radio.complaint() is None


def test_it_stays_in_reset_while_the_pin_is_low() -> None:
    radio = linked()
    lib.rn41_chip_set_reset(radio.chip, radio.now, True)
    radio.wait(0.0039)
    assert radio.pio2 == 1
    radio.wait(0.0002)
    assert radio.pio2 == -1
    radio.wait(100)
    assert radio.pio2 == -1


@pytest.mark.parametrize(("ms", "resets"), [(1, 0), (3.9, 0), (4.5, 1)])
def test_a_short_pulse_is_a_complaint(ms: float, resets: int) -> None:
    radio = linked()
    radio.reset_pulse(ms)
    assert radio.counters.resets == resets
    assert radio.complaint() == "a reset pulse of less than 5 ms"


def test_power_that_dips_starts_it_anew() -> None:
    radio = linked()
    lib.rn41_chip_power_cycle(radio.chip, radio.now)
    assert radio.pio2 == -1
    radio.wait(LINK)
    assert radio.pio2 == 1


# Faults


def test_a_dropped_link_loses_what_is_in_the_buffer() -> None:
    radio = linked(settings(SU="92"))
    radio.baud = 921_600
    radio.fault("DROP", radio.now / SECOND + 0.01, 5)
    radio.send(b"x" * 1000)  # 10.85 ms, some after the drop
    radio.host(b"y")
    radio.wait(0.1)
    assert radio.pio2 == 0
    counters = radio.counters
    assert len(radio.heard) == counters.to_host == 3 * 75
    assert counters.lost_to_host == 775
    assert counters.lost_from_host == 1
    radio.wait(4.8)
    assert radio.pio2 == 0
    radio.wait(0.2)
    assert radio.pio2 == 1
    assert counters.resets == 0
    assert radio.counters.links == 2


def test_a_host_that_is_away_comes_later() -> None:
    radio = Radio()
    radio.fault("AWAY", 0, 30)
    radio.until(29.9)
    assert radio.pio2 == 0
    radio.until(30.1)
    assert radio.pio2 == 1


def test_a_deaf_module_answers_nothing() -> None:
    radio = Radio()
    radio.fault("DEAF", 0, 10)
    radio.until(UP + 0.1)
    radio.send(b"$$$")
    radio.until(10)
    assert radio.said == b""
    assert radio.counters.lost_to_host == 3
    radio.command(11)


def test_one_that_restarts_by_itself_connects_again() -> None:
    radio = linked()
    radio.fault("RESET", LINK + 1)
    radio.until(LINK + 1.5)
    assert radio.pio2 == -1
    radio.until(LINK + 1 + LINK + 0.1)
    assert radio.pio2 == 1
    assert radio.counters.resets == 1


def test_what_has_no_model_is_a_complaint() -> None:
    radio = Radio()
    radio.command()
    assert radio.ask("SW,0320") == "?\r\n"
    assert radio.complaint() == "a setting that is not modelled"


def test_time_in_any_steps_is_the_same() -> None:
    runs = []
    for step in (0.0001, 0.0013, 1.0):
        radio = linked()
        radio.host(bytes(500))
        for _ in itertools.repeat(None, round(1.3 / step) + 1):
            radio.wait(step)
        runs.append((len(radio.said), radio.counters.from_host))
    assert runs == [(500, 500)] * 3
