# SPDX-License-Identifier: MIT
"""Shared by tests of both sensors: the chip on an I2C bus, the time, faults."""

from __future__ import annotations

from typing import Any, ClassVar

MS = 1_000_000  # ns
GYR, ACC, MAG = range(3)  # enum chip_quantity
GRAVITY = 9.80665  # m/s2

Triple = tuple[float, float, float]


class SensorDesk:
    """A sensor's model, the time in ns, and an I2C master at 400 kHz."""

    def __init__(
        self, name: str, ffi: Any, lib: Any, relative: str = "", **config: Any
    ) -> None:
        """`relative`: the chip that the model is to be, if it is not `name`."""
        self.name = relative or name
        self.ffi = ffi
        self.lib = lib
        self.config = ffi.new(f"struct {name}_chip_config *")
        self.config[0] = getattr(lib, f"{self.name}_chip_defaults")()
        sensor = self.config.sensor
        for key, value in config.items():
            if key == "motion":
                sensor.motion.function = value
            elif key == "is_recorded":
                sensor.motion.is_recorded = value
            else:
                setattr(sensor if hasattr(sensor, key) else self.config, key, value)
        made = getattr(lib, f"{name}_chip_new")(self.config)
        self.chip = ffi.gc(made, lib.sensor_chip_free)
        self.wire = self.call("wire")
        self.now = ffi.new("uint64_t *", 0)

    def call(self, what: str, *arguments: Any) -> Any:
        """Call a function of the model by the last part of its name."""
        return getattr(self.lib, f"sensor_chip_{what}")(self.chip, *arguments)

    def peek(self, reg: int, die: int = 1) -> int:
        return int(self.call("peek", die, reg))

    # Whole transactions. Those named try_ return 0, -1 (NACK) or -3 (SDA is held low).

    def try_get(self, address: int, reg: int, data: Any = None) -> int:
        data = self.ffi.new("uint8_t[1]") if data is None else data
        return int(
            self.lib.i2c_slave_read_registers(
                self.wire, self.now, address, reg, data, len(data)
            )
        )

    def get(self, address: int, reg: int, length: int = 1) -> list[int]:
        data = self.ffi.new("uint8_t[]", length)
        assert self.try_get(address, reg, data) == 0
        return list(data)

    def try_put(self, address: int, reg: int, *values: int) -> int:
        return int(
            self.lib.i2c_slave_write_registers(
                self.wire, self.now, address, reg, bytes(values), len(values)
            )
        )

    def put(self, address: int, reg: int, *values: int) -> None:
        assert self.try_put(address, reg, *values) == 0

    # Single bytes; they take no time.

    def start(self, address: int, *, is_read: bool) -> bool:
        now = self.now[0]
        return bool(self.lib.i2c_slave_start(self.wire, now, address, is_read))

    def send(self, byte: int) -> bool:
        return bool(self.lib.i2c_slave_write(self.wire, self.now[0], byte))

    def receive(self, *, ack: bool = True) -> int:
        return int(self.lib.i2c_slave_read(self.wire, self.now[0], ack))

    def stop(self) -> None:
        self.lib.i2c_slave_stop(self.wire, self.now[0])

    def pulse(self) -> None:
        self.lib.i2c_slave_scl_pulse(self.wire, self.now[0])

    def holds_sda(self) -> bool:
        return bool(self.lib.i2c_slave_holds_sda(self.wire, self.now[0]))

    # Time, motion, faults

    def advance(self, now_ns: int) -> None:
        self.now[0] = now_ns
        self.call("advance", now_ns)

    def wait(self, ms: float) -> None:
        self.advance(self.now[0] + round(ms * MS))

    def next_event(self) -> int:
        return int(self.call("next_event"))

    def hold(
        self,
        gyr: Triple = (0.0, 0.0, 0.0),
        acc: Triple = (0.0, 0.0, GRAVITY),
        mag: Triple = (0.0, 20.0, -40.0),
    ) -> None:
        """Set the motion from now on, in rad/s, m/s2 and uT."""
        self.call("hold", gyr, acc, mag)

    def try_fault(self, kind: str, **fields: int) -> bool:
        kind_of_fault = getattr(self.lib, f"CHIP_FAULT_{kind}")
        fault = self.ffi.new("struct chip_fault *", {"kind": kind_of_fault, **fields})
        return bool(self.lib.i2c_slave_add_fault(self.wire, fault))

    def fault(self, kind: str, **fields: int) -> None:
        assert self.try_fault(kind, **fields)

    def clear_faults(self) -> None:
        self.lib.i2c_slave_clear_faults(self.wire)

    def transactions(self) -> int:
        return int(self.call("transactions"))

    def complaint(self) -> str | None:
        text = self.call("complaint")
        return None if text == self.ffi.NULL else self.ffi.string(text).decode()


class StDesk(SensorDesk):
    """A sensor of ST: words of two bytes, low byte first."""

    # Of each sensor: address, first output register, status register, bits of it that
    # are set where all axes are new.
    PLACES: ClassVar[dict[int, tuple[int, int, int, int]]]
    ON = 0x80  # bit 7 of the sub-address: increment it after each byte

    def words(self, address: int, reg: int, count: int = 3) -> list[int]:
        data = bytes(self.get(address, self.ON | reg, 2 * count))
        return [
            int.from_bytes(data[i : i + 2], "little", signed=True)
            for i in range(0, 2 * count, 2)
        ]

    def counts(self, quantity: int = MAG) -> list[int]:
        """The three axes, read in one burst."""
        return self.words(*self.PLACES[quantity][:2])

    def status(self, quantity: int = MAG) -> int:
        address, _, reg, _ = self.PLACES[quantity]
        return self.get(address, reg)[0]

    def has_new(self, quantity: int) -> bool:
        new = self.PLACES[quantity][3]
        return self.status(quantity) & new == new

    def samples(self, quantity: int = MAG) -> int:
        return int(self.call("samples", quantity))

    def is_high(self, pin: int = 0) -> bool:
        return bool(self.call("pin_is_high", pin))

    def sample(self, quantity: int = MAG) -> int:
        """Let time pass until the next sample of a sensor; return its time in ns."""
        before = self.samples(quantity)
        while self.samples(quantity) == before:
            self.advance(self.next_event())
        return int(self.now[0])

    def settle(self, quantity: int) -> None:
        """Let the samples pass that come before the filters have settled."""
        self.sample(quantity)

    def times(self, quantity: int, count: int) -> list[int]:
        return [self.sample(quantity) for _ in range(count)]


def recorder(ffi: Any, quantity: int) -> tuple[Any, list[tuple[int, int]]]:
    """A motion that is zero, and the windows in which a model asked for `quantity`."""
    asked: list[tuple[int, int]] = []

    @ffi.callback("void(void *, enum chip_quantity, int64_t, int64_t, double *)")
    def motion(_context: Any, which: int, start: int, end: int, mean: Any) -> None:
        if which == quantity:
            asked.append((start, end))
        mean[0] = mean[1] = mean[2] = 0.0

    return motion, asked
