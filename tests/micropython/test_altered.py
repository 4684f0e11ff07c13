# SPDX-License-Identifier: MIT
"""The drivers of the package against chips that answer otherwise than they should."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode
from micropython_tape import Command

pytestmark = pytest.mark.long

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parents[1] / "firmware" / "micropython"
WHO_AM_I, USER_CTRL, PWR_MGMT_1 = 0x75, 0x6A, 0x6B
H_RESET = 0x80


class Write(NamedTuple):
    register: int
    value: int
    t_us: int


class Altered(NamedTuple):
    """A probe's messages, and its writes to its chip."""

    messages: list[Message]
    written: list[Write]

    @property
    def hello(self) -> dict[str, Any]:
        return dict(self.named("hello")[-1].fields)

    @property
    def state(self) -> Any:
        return self.named("status")[-1].fields["state"]

    def named(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]

    def faults(self) -> list[tuple[Any, Any]]:
        """Causes and details of what happened to the sensor."""
        return [
            (event.fields["cause"], event.fields["detail"])
            for event in self.named("event")
            if event.fields["event"] == "sensor_fault"
        ]


@pytest.fixture
def altered(micropython: Command, tmp_path: Path) -> Any:
    def run(kind: str, seconds: int, **about: Any) -> Altered:
        frames = tmp_path / "frames"
        words = [
            *micropython,
            HERE / "altered.py",
            HERE / "fake",
            PACKAGE,
            kind,
            frames,
        ]
        given = [f"{name.removeprefix('r_')}={value}" for name, value in about.items()]
        done = subprocess.run(
            [*words, str(seconds), *given], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        found = [
            decode(content) for content in FrameDecoder().feed(frames.read_bytes())
        ]
        assert all(isinstance(message, Message) for message in found)
        written = [Write(*map(int, line.split())) for line in done.stdout.splitlines()]
        return Altered([m for m in found if isinstance(m, Message)], written)

    return run


@pytest.mark.parametrize("identity", [0x70, 0x71, 0x73, 0x74, 0x75, 0x78, 0x12, 0x01])
def test_any_identity_runs_with_nine_axes_where_an_ak8963_answers(
    altered: Any, identity: int
) -> None:
    done = altered("mpu9250", 3, r_75=f"{identity:x}")
    assert done.faults() == []
    assert done.hello["sensor"] == "mpu9250"
    assert done.hello["who_am_i"] == (identity, 0x48)
    assert sum(raw.fields["mag"] is not None for raw in done.named("raw")) > 150


@pytest.mark.parametrize("identity", [0x00, 0xFF])
def test_what_is_no_identity_is_refused(altered: Any, identity: int) -> None:
    done = altered("mpu9250", 3, r_75=f"{identity:x}")
    assert set(done.faults()) == {("wrong_chip", identity)}
    assert done.state == "fault"
    assert not done.named("raw")


@pytest.mark.parametrize(
    ("kind", "held"),
    [("mpu9250", {"r_75": "3", "r_6b": "0"}), ("lsm9ds0", {"r_f": "3"})],
)
def test_nothing_is_written_to_a_clock_at_the_address(
    altered: Any, kind: str, held: dict[str, str]
) -> None:
    done = altered(kind, 1, **held)  # a DS3231 on a Tuesday
    assert set(done.faults()) == {("wrong_chip", 0x03)}
    assert done.written == []


@pytest.mark.parametrize(
    ("kind", "identity", "period_us"),
    [("mpu9250", 0x71, 5000), ("lsm9ds0", 0xD4, 2632)],
)
def test_a_magnetometer_that_never_measures_is_left_out_after_three_set_ups(
    altered: Any, kind: str, identity: int, period_us: int
) -> None:
    done = altered(kind, 10, mag="silent")
    assert done.faults() == [("mag_silent", identity)] * 3
    assert done.hello["who_am_i"] == (identity, 0)
    last = [raw.time_us for raw in done.named("raw") if raw.time_us > 8_000_000]
    assert len(last) == pytest.approx((last[-1] - last[0]) / period_us, abs=20)
    assert all(raw.fields["mag"] is None for raw in done.named("raw"))


@pytest.mark.parametrize("kind", ["mpu9250", "lsm9ds0"])
@pytest.mark.parametrize("from_us", [0, 2_000_000])
@pytest.mark.parametrize("what", ["ready=off", "bus=ff", "bus=0"])
def test_a_sensor_that_is_late_or_talks_nonsense_is_told_and_taken_back(
    altered: Any, kind: str, from_us: int, what: str
) -> None:
    about = {"from_us": from_us, "until_us": from_us + 1_500_000}
    done = altered(kind, 6, **about, **dict([what.split("=")]))
    told = {m.fields["event"] for m in done.named("event")}
    assert told & {"sensor_fault", "bus_fault"}
    assert "bus_recovered" in told
    times = [raw.time_us for raw in done.named("raw")]
    assert not [t for t in times if from_us + 20_000 < t < from_us + 1_500_000]
    assert len([t for t in times if t > 5_000_000]) > 190
    assert done.state == "streaming"


@pytest.mark.parametrize("identity", [0x70, 0x71, 0x75])
@pytest.mark.parametrize("mag", ["absent", "hung"])
def test_a_magnetometer_that_does_not_answer_costs_six_axes_nothing(
    altered: Any, identity: int, mag: str
) -> None:
    done = altered("mpu9250", 3, r_75=f"{identity:x}", mag=mag)
    assert done.faults() == []
    assert done.hello["sensor"] == "mpu6500"
    assert done.hello["who_am_i"] == (identity, 0)
    assert done.hello["mag_adjust"] == (0, 0, 0)
    raws = done.named("raw")
    assert len(raws) > 360
    assert not any(raw.fields["sample_flags"] for raw in raws)
    assert all(raw.fields["mag"] is None for raw in raws)


def test_a_magnetometer_that_was_hung_is_found_after_ten_seconds(altered: Any) -> None:
    done = altered("mpu9250", 13, mag="hung", until_us=2_000_000)
    assert done.faults() == [("mag_silent", 0x71)]
    (lost,) = (m for m in done.named("event") if m.fields["event"] == "sensor_fault")
    assert 10_000_000 < lost.time_us < 11_000_000
    assert done.hello["who_am_i"] == (0x71, 0x48)
    assert done.hello["mag_adjust"] != (0, 0, 0)
    assert done.state == "streaming"
    assert done.named("raw")[-1].time_us > 12_900_000
    fields = [m.time_us for m in done.named("raw") if m.fields["mag"] is not None]
    assert lost.time_us < fields[0]
    assert len(fields) > 100


def test_a_magnetometer_that_falls_silent_is_told_and_set_up_again(
    altered: Any,
) -> None:
    done = altered("mpu9250", 5, mag="silent", from_us=2_000_000, until_us=3_500_000)
    assert done.faults() == [("mag_silent", 0x71)]
    assert done.hello["who_am_i"] == (0x71, 0x48)
    fields = [m.time_us for m in done.named("raw") if m.fields["mag"] is not None]
    assert not [t_us for t_us in fields if 2_050_000 < t_us < 3_450_000]
    assert len([t_us for t_us in fields if t_us > 4_000_000]) > 80


@pytest.mark.parametrize("register", [0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x24, 0x38, 0x6C])
def test_a_register_that_does_not_hold_its_value_is_told_by_number(
    altered: Any, register: int
) -> None:
    done = altered("mpu9250", 2, **{f"r_{register:x}": "55"})
    assert set(done.faults()) == {("registers", 0x71 + 256 * register)}
    assert done.state == "fault"
    assert not done.named("raw")


@pytest.mark.parametrize(
    ("address", "register"), [(0xD4, 0x20), (0xD4, 0x23), (0x49, 0x1F), (0x49, 0x26)]
)
def test_an_lsm9ds0_is_read_back_as_well(
    altered: Any, address: int, register: int
) -> None:
    done = altered("lsm9ds0", 4, **{f"r_{register:x}": "55"})
    assert set(done.faults()) == {("registers", address + 256 * register)}


@pytest.mark.parametrize("force", [0.0, 7.2, 12.4, 78.0])
def test_a_force_that_is_not_near_1_g_is_refused_after_a_second(
    altered: Any, force: float
) -> None:
    done = altered("mpu9250", 4, force=force)
    assert set(done.faults()) == {("force", 0x71)}
    first = next(m for m in done.named("event") if m.fields["event"] == "sensor_fault")
    assert 1_300_000 < first.time_us < 1_500_000
    assert not done.named("raw")


@pytest.mark.parametrize("force", [7.5, 12.1])
def test_a_force_near_1_g_is_good_enough(altered: Any, force: float) -> None:
    assert altered("mpu9250", 2, force=force).faults() == []


def test_the_master_stops_3_ms_before_a_reset(altered: Any) -> None:
    written = altered("mpu9250", 1).written
    resets = [w for w in written if w[:2] == (PWR_MGMT_1, H_RESET)]
    assert len(resets) == 1
    before = written[written.index(resets[0]) - 1]
    assert before[:2] == (USER_CTRL, 0)
    assert resets[0].t_us - before.t_us >= 3000
