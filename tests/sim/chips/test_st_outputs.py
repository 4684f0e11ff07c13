# SPDX-License-Identifier: MIT
"""The outputs of the models of ST's sensors against the manufacturer's documents: block
data update (BDU), clock errors, recorded motion, and the faults that concern them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from sim.chips import lis3mdl_desk, lsm6dsox_desk, lsm6dsv16x_desk, lsm9ds0_desk
from sim.chips.sensor_desk import ACC, GYR, MAG, MS, recorder

SENSORS = {
    "LSM9DS0 gyroscope": (lsm9ds0_desk, GYR),
    "LSM9DS0 accelerometer": (lsm9ds0_desk, ACC),
    "LSM9DS0 magnetometer": (lsm9ds0_desk, MAG),
    "LSM6DSOX gyroscope": (lsm6dsox_desk, GYR),
    "LSM6DSOX accelerometer": (lsm6dsox_desk, ACC),
    "LSM6DSV16X gyroscope": (lsm6dsv16x_desk, GYR),
    "LSM6DSV16X accelerometer": (lsm6dsv16x_desk, ACC),
    "LIS3MDL": (lis3mdl_desk, MAG),
}
every_sensor = pytest.mark.parametrize("which", SENSORS.values(), ids=SENSORS)


class Sensor:
    """One sensor of a chip, running."""

    def __init__(
        self, which: tuple[Any, int], *, bdu: bool = True, **config: Any
    ) -> None:
        desk, self.quantity = which
        self.chip = desk.Chip(**config)
        self.address, self.out = self.chip.PLACES[self.quantity][:2]
        self.high = self.out + 1
        self.hold()
        self.chip.run(self.quantity, bdu=bdu)
        self.chip.settle(self.quantity)

    def hold(self, share: float = 1.0) -> None:
        """A motion that no axis reads as zero, or a share of it."""
        gyr, acc, mag = (tuple([share * each] * 3) for each in (1, 3, 30))
        self.chip.hold(gyr=gyr, acc=acc, mag=mag)

    def sample(self) -> int:
        return int(self.chip.sample(self.quantity))

    def counts(self) -> list[int]:
        counts: list[int] = self.chip.counts(self.quantity)
        return counts

    def samples(self) -> int:
        return int(self.chip.samples(self.quantity))

    def has_new(self) -> bool:
        return bool(self.chip.has_new(self.quantity))

    def begin_burst(self) -> None:
        chip = self.chip
        assert chip.start(self.address, is_read=False)
        assert chip.send(chip.ON | self.out)
        assert chip.start(self.address, is_read=True)

    def receive(self, count: int, *, is_end: bool = False) -> list[int]:
        last = count - 1 if is_end else count
        data = [self.chip.receive(ack=i < last) for i in range(count)]
        if is_end:
            self.chip.stop()
        return data


@pytest.fixture(params=SENSORS)
def sensor(request: pytest.FixtureRequest) -> Iterator[Sensor]:
    """A running sensor. Fails a test that used it against the documents."""
    sensor = Sensor(SENSORS[request.param])
    yield sensor
    assert sensor.chip.complaint() is None


@every_sensor
def test_all_is_off_after_power_up(which: tuple[Any, int]) -> None:
    desk, quantity = which
    chip = desk.Chip()
    assert chip.next_event() == 2**64 - 1
    chip.wait(1000)
    assert chip.samples(quantity) == 0
    assert not chip.has_new(quantity)


XYZ_STATUS = [name for name in SENSORS if "LSM6DS" not in name]


@pytest.mark.parametrize("sensor", XYZ_STATUS, indirect=True)
def test_each_axis_has_its_flags_and_its_high_byte_clears_them(sensor: Sensor) -> None:
    def status() -> int:
        return int(sensor.chip.status(sensor.quantity))

    sensor.sample()
    sensor.sample()
    assert status() == 0xFF  # overrun
    sensor.counts()
    assert status() == 0x00
    sensor.sample()
    sensor.chip.get(sensor.address, sensor.out)
    sensor.sample()
    assert status() & 0x90 == 0x00  # X is held, so that nothing of it was lost
    sensor.sample()
    assert status() & 0x10 == 0x10
    sensor.counts()
    sensor.counts()
    sensor.sample()
    sensor.chip.get(sensor.address, sensor.out)  # no low byte clears one (AN3308)
    assert status() == 0x0F
    seen = []
    for reg in (sensor.high, sensor.high + 2, sensor.high + 4):
        sensor.chip.get(sensor.address, reg)
        seen.append(status())
    assert seen == [0x0E, 0x0C, 0x00]


@every_sensor
def test_without_bdu_a_burst_across_an_update_is_torn(which: tuple[Any, int]) -> None:
    sensor = Sensor(which, bdu=False)
    before = sensor.counts()[0]
    sensor.begin_burst()
    data = sensor.receive(1)
    sensor.hold(0)
    sensor.sample()
    data += sensor.receive(5, is_end=True)
    assert data == [before & 0xFF, 0, 0, 0, 0, 0]


def test_bdu_holds_an_axis_until_both_halves_are_read(sensor: Sensor) -> None:
    before = sensor.counts()
    sensor.sample()
    low = sensor.chip.get(sensor.address, sensor.out)
    sensor.hold(0)
    sensor.sample()
    word = bytes(low + sensor.chip.get(sensor.address, sensor.high))
    assert int.from_bytes(word, "little", signed=True) == before[0]
    # Then the sample that came meanwhile shows, and is flagged as new.
    assert sensor.has_new()
    assert sensor.counts() == [0, 0, 0]


def test_bdu_does_not_hold_the_axes_together(sensor: Sensor) -> None:
    before = sensor.counts()
    sensor.begin_burst()
    data = sensor.receive(3)
    sensor.hold(0)
    sensor.sample()  # X and half of Y have been read
    data += sensor.receive(3, is_end=True)
    words = [
        int.from_bytes(bytes(data[i : i + 2]), "little", signed=True) for i in (0, 2, 4)
    ]
    assert words == [*before[:2], 0]  # AN5040, 4.4: X and Y from T1, Z from T2


def test_bdu_off_lets_go(sensor: Sensor) -> None:
    sensor.chip.get(sensor.address, sensor.out)
    sensor.hold(0.5)
    sensor.sample()
    sensor.chip.bdu_off(sensor.quantity)
    x, y, _ = sensor.counts()
    assert abs(x) == abs(y) != 0


ERRORS = {
    "LSM9DS0 gyroscope": "g_rate_error_ppm",
    "LSM9DS0 accelerometer": "xm_rate_error_ppm",
    "LSM9DS0 magnetometer": "xm_rate_error_ppm",
}


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("ppm", [-10_000.0, 250.0, 10_000.0])
def test_a_rate_error_adds_up_without_drift(name: str, ppm: float) -> None:
    config: dict[str, Any] = {ERRORS.get(name, "rate_error_ppm"): ppm}
    right, wrong = Sensor(SENSORS[name]), Sensor(SENSORS[name], **config)
    count = 4000
    spans = [
        -each.sample() + each.chip.times(each.quantity, count)[-1]
        for each in (right, wrong)
    ]
    assert spans[1] == pytest.approx(spans[0] / (1 + ppm * 1e-6), abs=40)


RECORDED = {name: which for name, which in SENSORS.items() if which[1] != MAG}


@pytest.mark.parametrize("which", RECORDED.values(), ids=RECORDED)
def test_recorded_motion_is_brought_to_the_rate_alone(which: tuple[Any, int]) -> None:
    motion, asked = recorder(which[0].ffi, which[1])
    sensor = Sensor(which, motion=motion, is_recorded=True)
    first, second = sensor.sample(), sensor.sample()
    half = round((second - first) / 2)
    start, end = asked[-1]
    assert (start, end) == pytest.approx((second - half, second + half), abs=1)


def test_data_ready_can_stop(sensor: Sensor) -> None:
    chip = sensor.chip
    chip.wait(100)
    before = sensor.samples()
    chip.wait(100)
    usual = sensor.samples() - before
    chip.fault("NO_DATA_READY", from_ns=chip.now[0], for_ns=100 * MS)
    sensor.counts()
    before = sensor.samples()
    chip.wait(99)
    assert sensor.samples() == before
    assert not sensor.has_new()
    chip.wait(100)
    assert sensor.samples() - before == pytest.approx(usual, abs=1)


def test_data_ready_of_one_sensor_alone_can_stop(sensor: Sensor) -> None:
    sensor.chip.fault("NO_DATA_READY", value=1 + (sensor.quantity + 1) % 3)
    sensor.sample()
    sensor.chip.clear_faults()
    sensor.chip.fault("NO_DATA_READY", value=1 + sensor.quantity)
    before = sensor.samples()
    sensor.chip.wait(100)
    assert sensor.samples() == before


def test_outputs_can_freeze_while_data_ready_goes_on(sensor: Sensor) -> None:
    frozen = sensor.counts()
    sensor.chip.fault("FROZEN")
    sensor.hold(0.5)
    sensor.sample()
    assert sensor.has_new()
    assert sensor.counts() == frozen
    sensor.chip.clear_faults()
    sensor.sample()
    assert sensor.counts() != frozen


@pytest.mark.parametrize("how", ["power_cycle", "BROWN_OUT"])
@every_sensor
def test_power_loss_forgets_everything(which: tuple[Any, int], how: str) -> None:
    sensor = Sensor(which)
    chip = sensor.chip
    chip.wait(50)
    if how == "power_cycle":
        chip.call(how, chip.now[0])
    else:
        chip.fault(how, from_ns=chip.now[0])
        chip.wait(0)
    fresh = which[0].Chip()
    addresses = {place[0] for place in chip.PLACES.values()}
    for address in addresses:
        registers = chip.get(address, chip.ON | 0, 128)
        assert registers == fresh.get(address, chip.ON | 0, 128)
    chip.wait(100)
    assert not sensor.has_new()


FLIPS = {GYR: (0x11, 0x00), ACC: (0x10, 0x00), MAG: (0x22, 0x03)}  # off


@pytest.mark.parametrize("name", [name for name in SENSORS if "LSM9DS0" not in name])
def test_a_register_can_flip_and_what_it_does_with_it(name: str) -> None:
    sensor = Sensor(SENSORS[name])
    chip = sensor.chip
    reg, value = FLIPS[sensor.quantity]
    chip.fault("REGISTER_FLIP", reg=reg, value=value, from_ns=chip.now[0] + 50 * MS)
    chip.wait(60)
    before = sensor.samples()
    chip.wait(100)
    assert chip.get(sensor.address, reg) == [value]
    assert sensor.samples() == before


@pytest.mark.parametrize(
    ("die", "expected"),
    [("BOTH", [0x55, 0x55]), ("G", [0x55, 0x00]), ("XM", [0x00, 0x55])],
)
def test_a_register_of_either_die_can_flip(die: str, expected: list[int]) -> None:
    chip = lsm9ds0_desk.Chip()
    chip.fault("REGISTER_FLIP", die, reg=0x30, value=0x55)
    chip.wait(0)
    flipped = [chip.get(address, 0x30)[0] for address in (0x6B, 0x1D)]
    assert flipped == expected
