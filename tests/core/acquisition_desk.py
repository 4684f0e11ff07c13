# SPDX-License-Identifier: MIT
"""The way from a sensor to samples, over a board of the test's own."""

from __future__ import annotations

from typing import Any

from core.desk import ffi, lib
from core.probe_bench import MPU9250, REST, Bench, callbacks

MILLISECOND = 1000
RETRY_US = 200 * MILLISECOND
SILENCE_US = 50 * MILLISECOND
BURSTS = [(0x68, 0x3B, 14), (0x0C, 0x02, 8)]
BAD = 0xEE  # the first byte of what can be no reading


class Board:
    """A sensor, its bus and the interrupts of a board, as far as acquisition knows."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.calls: list[str] = []
        self.bursts = BURSTS
        self.setup_results = [lib.SENSOR_BUSY, lib.SENSOR_OK]
        self.check_result = lib.SENSOR_BUSY
        self.recovered = lib.BUS_OK
        self.readings: list[tuple[int, int, int]] = []  # result, missed, first byte
        self.age_us = 0  # of a reading, when it is taken
        self.gaps: list[bool] = []
        self._kept = [
            callbacks(
                "struct sensor_driver",
                check=self._check,
                begin=lambda _: self.calls.append("begin"),
                setup=self._setup,
                parse=self._parse,
            ),
            callbacks(
                "struct acquisition_port",
                recover_bus=self._recover,
                start_sampling=self._start,
                stop_sampling=lambda: self.calls.append("stop"),
                take_reading=self._take,
            ),
        ]
        driver, port = self._kept
        self.identity = ffi.new("struct sensor_identity *", MPU9250[0])
        self._bursts = ffi.new("struct bus_burst[]", BURSTS)
        driver |= {
            "identity": self.identity,
            "bursts": self._bursts,
            "bursts_count": len(BURSTS),
        }
        self._driver = ffi.new("struct sensor_driver *", driver)
        self._bus = ffi.new("struct bus_device *")  # the driver's affair
        port |= {"sensor": self._driver, "bus": self._bus}
        self._port = ffi.new("struct acquisition_port *", port)
        self.c = ffi.new("struct acquisition *")
        lib.acquisition_begin(self.c, self._port, self.bench.c)

    def _setup(self, _: Any, bus: Any, now_us: int) -> int:
        assert now_us == self.bench.time_us
        assert bus == self._bus
        return int(self.setup_results.pop(0))

    def _check(self, _: Any, bus: Any) -> int:
        assert bus == self._bus
        self.calls.append("check")
        return int(self.check_result)

    def _parse(self, _: Any, data: Any, time_us: int, out: Any) -> bool:
        if data[0] == BAD:
            return False
        has_gap = bool(out.has_gap)
        ffi.buffer(out)[:] = REST[0].tobytes()
        out.has_gap, out.time_us = has_gap, time_us
        self.gaps.append(has_gap)
        return True

    def _recover(self) -> int:
        self.calls.append("recover")
        return int(self.recovered)

    def _start(self, bursts: Any, count: int) -> None:
        found = [(b.address, b.reg, b.length) for b in bursts[0:count]]
        assert found == self.bursts
        self.calls.append("start")

    def _take(self, out: Any) -> int:
        if not self.readings:
            return int(lib.READING_NONE)
        result, out.missed, out.bytes[0] = self.readings.pop(0)
        out.time_us = self.bench.time_us - self.age_us
        return int(result)

    def step(self, elapsed_us: int = MILLISECOND) -> bool:
        self.bench.now_us += elapsed_us
        return bool(lib.acquisition_step(self.c, self.bench.time_us))

    def take(self, result: int, missed: int = 0, first: int = 0) -> bool:
        """One step with a reading."""
        self.readings.append((result, missed, first))
        return self.step()

    def sampling(self) -> Board:
        while self.c.phase != lib.ACQUISITION_SAMPLING:
            assert not self.step()
        self.calls.clear()
        self.bench.messages.clear()
        return self

    def streaming(self) -> Board:
        self.bench.command(lib.COMMAND_FIELDS, lib.STREAM_RAW)
        self.bench.command(lib.COMMAND_START)
        return self

    @property
    def samples(self) -> int:
        return int(self.bench.c.status.samples_read)

    @property
    def is_faulty(self) -> bool:
        return bool(self.bench.state == lib.STATE_FAULT)

    def gives_up_for(self, event: int, cause: int, detail: int = 0) -> None:
        """It has stopped, freed the bus, told why, and waits for the next attempt."""
        assert self.calls[-2:] == ["stop", "recover"]
        assert self.bench.events()[-1] == (event, cause, detail)
        assert self.is_faulty
        self.calls.clear()
        self.recovered = lib.BUS_OK
        self.setup_results = [lib.SENSOR_OK]
        assert not self.step(RETRY_US - 1)
        assert self.calls == []
        self.step(1)
        assert self.calls == ["begin"]
        self.step()
        assert self.calls == ["begin", "start"]
        assert not self.is_faulty
        assert self.bench.events()[-1][0] == lib.EVENT_BUS_RECOVERED
        assert self.take(lib.READING_OK)
        assert self.gaps.pop()
