# SPDX-License-Identifier: MIT
"""The model of the RN-41 against the manufacturer's documents: command mode.

Words and numbers are typed from the user's guide (RN-BT-DATA-UG 1.0r), the manual of
firmware 4.77 and the data sheet (DS50002280B), not taken from the model.
"""

from __future__ import annotations

import pytest

from sim.chips.rn41_desk import FACTORY, LINK, SECOND, UP, Radio, lib, linked, settings


def test_three_characters_with_silence_open_command_mode() -> None:
    radio = Radio()
    radio.command()
    assert radio.output == b"CMD\r\n"
    assert radio.heard == b""


def test_bytes_within_a_second_before_make_them_data() -> None:
    radio = linked()
    radio.send(b"x")
    radio.wait(0.98)
    radio.send(b"$$$")
    radio.wait(2)
    assert radio.heard == b"x$$$"
    assert radio.output == b""
    radio.send(b"$$$")  # after a pause
    radio.wait(2)
    assert radio.output == b"CMD\r\n"


@pytest.mark.parametrize("tail", [b"x", b"$"])
def test_bytes_after_make_them_data(tail: bytes) -> None:
    radio = linked(command_ns=SECOND)
    radio.send(b"$$$")
    radio.wait(0.98)
    radio.send(tail)
    radio.wait(2)
    assert radio.heard == b"$$$" + tail
    assert radio.output == b""


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
    assert (radio.output == b"CMD\r\n") is opens
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
    # A new setting is reported at once and used after a reboot.
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
    assert again.output == b"CMD\r\n"
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
    radio.output = b""
    radio.send(b"GU\r\n")
    radio.wait(0.2)
    radio.send(b"GT\r\n")
    radio.wait(0.2)
    assert radio.output == b"115K\r\n255\r\n"


def test_commands_wait_for_the_answer_before() -> None:
    radio = Radio()
    radio.command()
    radio.output = b""
    radio.send(b"GU\rGT\rGA\r")
    radio.wait(0.2)
    assert radio.output == b"115K\r\n255\r\n1\r\n"


def test_a_host_may_come_while_it_is_configured() -> None:
    radio = Radio()
    radio.command()
    radio.until(LINK + 0.1)
    assert radio.pio2 == 1
    assert radio.ask("GK") == "1,0,0\r\n"
    radio.host(b"lost, nobody passes it on")  # UG, command T
    radio.wait(0.1)
    assert radio.ask("---") == "END\r\n"
    radio.host(b"heard")
    radio.wait(0.1)
    assert radio.output.endswith(b"END\r\nheard")
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
    lines = radio.output.decode().splitlines()
    connect = next(line for line in lines if "CONNECT" in line)
    assert connect.startswith("%CONNECT,")
    assert lines == [connect, "%DISCONNECT", connect, "%REBOOT", connect]


def test_a_long_answer_is_a_line_s_time() -> None:
    radio = Radio()
    radio.command()
    begin = radio.now
    radio.output = b""
    radio.send(b"D\r")
    while not radio.output.endswith(b"NONE SET\r\n"):
        radio.wait(0.0001)
    took = (radio.now - begin) / SECOND
    bits = 10 * (len(radio.output) + 2)
    assert took == pytest.approx(bits / FACTORY + 0.005, abs=0.0003)
