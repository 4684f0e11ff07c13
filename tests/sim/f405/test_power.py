# SPDX-License-Identifier: MIT
"""Radio, battery and STOP mode of the virtual STM32F405, each with a bare program."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

import bare

pytestmark = pytest.mark.sampled(2)

HOUR_US = 3_600_000_000
FULL_SCALE, SUPPLY_MV = 4095, 3300
RADIO = """address=0006664F1A2C
SN=imu-probe-1A2C
SU=92
SM=0
SA=1
SP=1234
ST=0
SO=Z
SS=SPP
S$=$
"""


def counts(cell_mv: float) -> float:
    """The ADC's reading of half of the cell's voltage."""
    return cell_mv / 2 * FULL_SCALE / SUPPLY_MV


def radio(folder: Path, text: str = RADIO) -> tuple[str, str]:
    path = folder / "radio"
    path.write_text(text)
    return ("--radio", str(path))


# Flow control


def test_cts_stops_usart2_between_bytes(tmp_path: Path) -> None:
    output = bare.run("flow", tmp_path)
    lines = output.lines
    assert lines["clear"] == [0]
    assert lines["raised"] == [1]  # CTS has changed
    assert lines["held"] == [0]  # neither TXE nor TC is set
    assert lines["cleared"] == [0]
    assert lines["fallen"] == [1]
    assert lines["us"][0] in (9, 10)  # the byte that had waited, at 1 Mbaud
    assert lines["middle"] == [0]
    assert b"\n123\n" in output.data
    assert output.summary["firmware_complaint"] == "USART2 waits for a CTS that floats"


# Radio


def test_the_radio_s_wires(tmp_path: Path) -> None:
    text = bytes(range(200)).hex()
    more = (*radio(tmp_path), "--send", f"4000000:{text}")
    output = bare.run("radio", tmp_path, *more)
    lines = output.lines
    assert lines["starting"] == lines["during"] == [1]  # pulled up, not driven
    assert lines["up"][0] == pytest.approx(1_000_000, abs=200)
    assert lines["connected"][0] == pytest.approx(3_000_000, abs=200)
    assert lines["again"][0] == pytest.approx(1_000_000, abs=200)
    assert lines["entered"] == lines["left"] == [5]
    assert lines["command"] == [int.from_bytes(b"CMD\r", "big")]
    assert lines["name"] == [int.from_bytes(b"imu-", "big")]
    # For 0.1 s the program read nothing, and RTS kept the bytes in the radio.
    assert lines["errors"] == [0]
    assert lines["count"] == lines["right"] == [200]
    # 20,000 bytes at 30,000 a second, less those still in the buffer.
    assert lines["us"][0] == pytest.approx((20_000 - 1536) / 0.03, rel=0.03)
    summary = output.summary
    assert summary["uart_overruns"] == 0
    assert summary["radio_to_host"] == len(output.data) == summary["bytes"]
    assert summary["radio_from_host"] == 200
    assert summary["radio_lost_to_host"] == summary["radio_lost_from_host"] == 0
    assert summary["radio_commands"] == 2
    assert summary["radio_writes"] == 0
    assert summary["radio_resets"] == 1
    assert summary["radio_links"] == 2
    assert summary["radio_complaint"] is None
    assert summary["firmware_complaint"] is None
    assert (tmp_path / "radio").read_text() == RADIO


def test_a_wrong_rate_is_garbage_with_framing_errors(tmp_path: Path) -> None:
    path = tmp_path / "radio"
    more = ("--radio", str(path), "--send", "4000000:4040404040")
    output = bare.run("garbage", tmp_path, *more)
    assert output.lines["count"] == output.lines["unframed"] == [5]
    assert output.lines["right"] == [0]
    # Nobody has set the radio up, so the file has the factory's settings.
    assert "SU=11\n" in path.read_text()
    assert "ST=255\n" in path.read_text()


def test_a_link_that_drops_loses_what_is_under_way(tmp_path: Path) -> None:
    drop = {"kind": "radio_drop", "at_us": 4_400_000, "for_us": 100_000}
    more = (*radio(tmp_path), *bare.faults(tmp_path, drop))
    summary = bare.run("radio", tmp_path, *more).summary
    assert summary["radio_lost_to_host"] > 0
    assert summary["radio_links"] == 3
    assert summary["radio_resets"] == 1


def test_runs_with_a_radio_are_the_same(tmp_path: Path) -> None:
    restart = {"kind": "radio_reset", "at_us": 7_000_000}
    deaf = {"kind": "radio_deaf", "at_us": 4_500_000, "for_us": 50_000}
    away = {"kind": "radio_away", "for_us": 4_000_000}
    more = bare.faults(tmp_path, restart, deaf, away)
    runs = [bare.run("radio", tmp_path, *radio(tmp_path), *more) for _ in range(2)]
    assert runs[0] == runs[1]
    assert runs[0].summary["radio_resets"] == 2
    assert runs[0].lines["connected"][0] == pytest.approx(4_000_000, abs=200)


def test_a_cable_has_nothing_of_a_radio(tmp_path: Path) -> None:
    summary = bare.run("stack", tmp_path).summary
    assert not [name for name in summary if "radio" in name]
    assert "stopped_us" not in summary


# Battery


def test_a_pin_that_floats_keeps_its_charge_and_drifts(tmp_path: Path) -> None:
    lines = bare.ended("cell", tmp_path)
    up, down = lines["up"][0], lines["down"][0]
    assert up > 0.7 * FULL_SCALE
    assert down < 0.3 * FULL_SCALE
    # Its charge drifts to the reference (1.21 V), which was converted in between.
    assert lines["drifted"][0] == pytest.approx(1502, abs=3)
    assert set(lines["charger"]) == {3}


def test_a_cell_is_half_of_its_voltage(tmp_path: Path) -> None:
    lines = bare.ended("cell", tmp_path, "--battery", "3700")
    for name in ("up", "down", "drifted", "counts"):
        for value in lines[name]:
            assert value == pytest.approx(counts(3700), abs=2)
    assert set(lines["charger"]) == {3}
    # The divider's 50 kohm can't charge the sampling capacitor in 3 cycles.
    assert 1502 < lines["hasty"][0] < counts(3700) - 50


def test_a_cell_that_empties_is_a_straight_line(tmp_path: Path) -> None:
    falls = {"kind": "battery", "mv": 4200, "to_mv": 3200, "for_us": 500_000}
    lines = bare.ended("cell", tmp_path, *bare.faults(tmp_path, falls))
    expected = [counts(4200 - 200 * i) for i in range(1, 6)]
    assert lines["counts"] == pytest.approx(expected, abs=3)


def test_an_empty_cell_reads_nothing(tmp_path: Path) -> None:
    lines = bare.ended("cell", tmp_path, "--battery", "0")
    assert max(lines["up"] + lines["down"] + lines["counts"]) <= 1


def test_the_charger_pulls_its_pins_low(tmp_path: Path) -> None:
    events = [
        {"kind": "charger", "at_us": 50_000, "value": 1},
        {"kind": "charger", "at_us": 150_000, "value": 3},
        {"kind": "charger", "at_us": 250_000, "value": 2},
        {"kind": "charger", "at_us": 350_000, "value": 0},
    ]
    more = ("--battery", "3700", *bare.faults(tmp_path, *events))
    assert bare.ended("cell", tmp_path, *more)["charger"] == [2, 0, 1, 3, 3]


# STOP


def stop(folder: Path, first_us: int = HOUR_US) -> bare.Output:
    second_us = first_us + 1_000_000
    presses = (f"{first_us}:{first_us + 1000}", f"{second_us}:{second_us + 1000}")
    more = [part for press in presses for part in ("--press", press)]
    output = bare.run("stop", folder, *more)
    assert output.summary["firmware_complaint"] is None
    return output


def test_stop_mode_ends_with_an_edge_on_the_inner_oscillator(tmp_path: Path) -> None:
    output = stop(tmp_path)
    lines = output.lines
    assert lines["edges"] == [1, 1]
    # Neither SysTick nor the timer has counted.
    assert lines["ticks"] == [0]
    assert lines["counted"][0] <= 3
    assert lines["sws"] == [0]
    assert lines["oscillators"] == [3]  # HSI is on and ready, HSE is off
    # Two sleeps that a press ended, and one that the watchdog ended after 0.1 s.
    assert output.summary["stopped_us"] == pytest.approx(HOUR_US + 1_100_000, abs=6000)


def test_an_hour_asleep_costs_nothing(tmp_path: Path) -> None:
    bare.emulator()

    def used() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    before = used()
    stop(tmp_path)
    assert used() - before < 10


def test_a_pending_line_keeps_it_awake(tmp_path: Path) -> None:
    assert stop(tmp_path).lines["at_once"][0] <= 3


def test_an_event_wakes_without_an_interrupt(tmp_path: Path) -> None:
    lines = stop(tmp_path).lines
    assert lines["event"] == [0]
    assert lines["edges"] == [1, 1]


def test_what_is_pending_and_masked_can_be_an_event(tmp_path: Path) -> None:
    # 12,000 cycles of 16 MHz.
    assert stop(tmp_path).lines["pended"][0] == pytest.approx(750, abs=5)


def test_the_watchdog_goes_on_in_stop_mode(tmp_path: Path) -> None:
    lines = stop(tmp_path).lines
    assert lines["cause"] == [0x0E, 0x24]
    assert "woken" not in lines


# Mistakes


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["--battery", "3.7"], "--battery takes millivolts"),
        (["--battery", "7000"], "--battery takes millivolts"),
        (["--battery", "-1"], "--battery takes millivolts"),
        (["--radio", "{folder}/not"], "has no settings of an RN-41"),
        (["--faults", "{folder}/drop"], "is for a radio: --radio FILE"),
        (["--faults", "{folder}/mv"], "mv is above 6600"),
    ],
)
def test_a_mistake_is_told(tmp_path: Path, more: list[str], expected: str) -> None:
    (tmp_path / "not").write_text("something else\n")
    (tmp_path / "drop").write_text('[{"kind": "radio_drop", "at_us": 1}]')
    (tmp_path / "mv").write_text('[{"kind": "battery", "mv": 6601}]')
    given = [text.format(folder=tmp_path) for text in more]
    error = bare.refused("stack", *given)
    assert expected in error.splitlines()[0]
