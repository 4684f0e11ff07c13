# SPDX-License-Identifier: MIT
"""The modules that the virtual boards choose from, on their wire."""

from __future__ import annotations

from typing import Any

import pytest

import native

ffi, lib = native.load()

IMU, MAG = 0x6A, 0x1C
ON = 0x80
NOBODY = None


class Module:
    """A module and an I2C master that reads and writes single registers."""

    def __init__(self, name: str) -> None:
        self.name = ffi.new("char[]", name.encode())
        config = {"name": self.name, "starts_at_once": True}
        self.module = ffi.gc(
            lib.module_new(ffi.new("struct module_config *", config)), lib.module_free
        )
        self.bus = lib.module_bus(self.module)
        self.now = 0

    def _to(self, address: int, reg: int) -> bool:
        self.now += 100_000
        return bool(
            lib.i2c_bus_start(self.bus, self.now, address, False)
            and lib.i2c_bus_write(self.bus, self.now, reg)
        )

    def read(self, address: int, reg: int, count: int = 1) -> list[int] | None:
        values = NOBODY
        if self._to(address, reg) and lib.i2c_bus_start(
            self.bus, self.now, address, True
        ):
            lasts = [i + 1 == count for i in range(count)]
            values = [lib.i2c_bus_read(self.bus, self.now, not is_l) for is_l in lasts]
        lib.i2c_bus_stop(self.bus, self.now)
        return values

    def write(self, address: int, reg: int, value: int) -> None:
        assert self._to(address, reg)
        assert lib.i2c_bus_write(self.bus, self.now, value)
        lib.i2c_bus_stop(self.bus, self.now)

    def who(self) -> list[list[int] | None]:
        return [self.read(IMU, 0x0F), self.read(MAG, 0x0F)]

    def fault(self, kind: str, **fields: Any) -> None:
        fields["kind"] = getattr(lib, f"CHIP_FAULT_{kind}")
        assert lib.module_add_fault(self.module, ffi.new("struct chip_fault *", fields))

    def wait(self, ms: float) -> None:
        self.now += round(ms * 1e6)
        lib.module_advance(self.module, self.now)

    def is_high(self) -> bool:
        return bool(lib.module_pin_is_high(self.module))

    def complaint(self) -> Any:
        return lib.module_complaint(self.module)


@pytest.fixture
def pair() -> Module:
    return Module("lsm6dsox")


@pytest.fixture(params=[("lsm6dsox", 0x6C), ("lsm6dsv16x", 0x70)])
def either(request: pytest.FixtureRequest) -> tuple[Module, list[int]]:
    """A pair, and the identity of its inertial chip."""
    name, who = request.param
    return Module(name), [who]


def test_a_module_has_its_chips() -> None:
    found = {}
    for name in ("mpu9250", "lsm6dsox", "ism330dhcx", "lsm6dsv16x"):
        module = Module(name)
        answers = {at: module.read(at, 0x0F) for at in range(128)}
        found[name] = {at: who for at, who in answers.items() if who is not NOBODY}
    assert list(found.pop("mpu9250")) == [0x68]
    assert found == {
        "lsm6dsox": {MAG: [0x3D], IMU: [0x6C]},
        "ism330dhcx": {MAG: [0x3D], IMU: [0x6B]},
        "lsm6dsv16x": {MAG: [0x3D], IMU: [0x70]},
    }


def test_an_unknown_name_gives_none() -> None:
    name = ffi.new("char[]", b"bno055")
    wrong = ffi.string(lib.module_misnamed(name))
    assert wrong.startswith(b"--sensor is one of mpu9250, lsm6dsox, ")
    config = ffi.new("struct module_config *", {"name": name})
    assert lib.module_new(config) == ffi.NULL
    assert lib.module_misnamed(ffi.NULL) == ffi.NULL


def test_both_chips_of_the_pair_measure_the_same_motion(pair: Module) -> None:
    pair.write(IMU, 0x12, 0x44)
    pair.write(IMU, 0x10, 0x50)
    pair.write(IMU, 0x0D, 0x01)
    pair.write(MAG, 0x20, 0x7C)
    pair.write(MAG, 0x22, 0x00)
    assert not pair.is_high()
    pair.wait(50)
    assert pair.is_high()  # INT1 of the LSM6DSOX
    acc, mag = pair.read(IMU, 0x28, 6), pair.read(MAG, ON | 0x28, 6)
    assert acc is not NOBODY
    assert mag is not NOBODY
    # Lying level, in a field of (0, 20, -40) uT.
    assert acc[:4] == [0] * 4
    assert acc[4] + 256 * acc[5] == round(1000 / 0.061)
    y = mag[2] + 256 * mag[3]
    z = mag[4] + 256 * mag[5] - 65_536
    assert (y, z) == (round(0.2 * 6842), round(-0.4 * 6842))
    assert not pair.is_high()
    assert pair.complaint() == ffi.NULL


def test_something_happens_as_soon_as_it_does_in_either_chip(pair: Module) -> None:
    assert lib.module_next_event(pair.module) == 2**64 - 1
    pair.write(MAG, 0x20, 0x7C)
    pair.write(MAG, 0x22, 0x00)
    slow = lib.module_next_event(pair.module)
    pair.write(IMU, 0x10, 0x60)
    fast = lib.module_next_event(pair.module)
    assert pair.now < fast < slow


@pytest.mark.parametrize(
    ("die", "answers"), [(0, (False, False)), (1, (False, True)), (2, (True, False))]
)
def test_a_fault_is_of_both_chips_or_of_one(
    either: tuple[Module, list[int]], die: int, answers: tuple[bool, bool]
) -> None:
    pair, who = either
    pair.fault("NACK", die=die)
    assert pair.who() == [
        who if answers[0] else NOBODY,
        [0x3D] if answers[1] else NOBODY,
    ]


def test_the_magnetometer_can_die_alone(either: tuple[Module, list[int]]) -> None:
    pair, who = either
    pair.fault("NO_MAG", from_ns=50_000_000)
    assert pair.who() == [who, [0x3D]]
    pair.wait(50)
    assert pair.who() == [who, NOBODY]


@pytest.mark.parametrize(
    ("kind", "limit"), [("GYR", 20 / 8.75e-3), ("ACC", 50 / 0.061)]
)
def test_self_tests_that_fail_are_those_of_the_first_chip(
    pair: Module, kind: str, limit: float
) -> None:
    pair.fault(f"{kind}_SELF_TEST")
    reg = {"GYR": 0x22, "ACC": 0x28}[kind]
    pair.write(IMU, 0x10, 0x50)
    pair.write(IMU, 0x11, 0x50)
    pair.write(IMU, 0x14, 0x05)
    pair.wait(200)
    x = pair.read(IMU, reg, 2)
    assert x is not NOBODY
    assert 0 < x[0] + 256 * x[1] < limit


@pytest.mark.parametrize("die", [0, 1, 2])
def test_a_stuck_line_is_held_by_one_chip_and_let_go_by_its_clocks(
    either: tuple[Module, list[int]], die: int
) -> None:
    pair, who = either
    pair.fault("STUCK_SDA", die=die, clocks=3)
    assert pair.who() == [NOBODY, NOBODY]
    for _ in range(3):
        assert lib.i2c_bus_holds_sda(pair.bus, pair.now)
        lib.i2c_bus_scl_pulse(pair.bus, pair.now)
    assert pair.who() == [who, [0x3D]]


@pytest.mark.parametrize("how", ["power_cycle", "BROWN_OUT"])
def test_loss_of_power_is_of_both(either: tuple[Module, list[int]], how: str) -> None:
    pair, _ = either
    pair.write(IMU, 0x10, 0x50)
    pair.write(MAG, 0x20, 0x7C)
    if how == "power_cycle":
        lib.module_power_cycle(pair.module, pair.now)
    else:
        pair.fault(how)
        pair.wait(0)
    assert (pair.read(IMU, 0x10), pair.read(MAG, 0x20)) == ([0x00], [0x10])


@pytest.mark.parametrize(("address", "reg"), [(IMU, 0x0F), (MAG, 0x0F)])
def test_a_complaint_of_either_is_told(pair: Module, address: int, reg: int) -> None:
    pair.write(address, reg, 0)
    assert b"read-only" in ffi.string(pair.complaint())
    assert lib.module_transactions(pair.module) == 1
