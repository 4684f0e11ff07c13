# SPDX-License-Identifier: MIT
"""A probe without the C module: raw samples, for a host that fuses them. Its methods
are those of imuprobe.Probe."""

import struct
from time import ticks_add, ticks_diff, ticks_us

from micropython import const

from . import wire
from .button import Button
from .link import Link, message
from .plain_equipment import Equipment
from .plain_settings import Settings, id_of, is_rate
from .plain_status import Status
from .plain_streams import Streams

_STEP_US = const(5000)
_SECOND_US = const(1_000_000)
_HELLO_US = const(500_000)
_RETRY_US = const(200_000)  # between two attempts to bring the sensor up
_SILENCE_US = const(50_000)  # without data-ready
_MISSED_US = const(8_000)  # three samples of the LSM9DS0, whose data-ready stays high
_FAILED_MAX = const(5)  # readings in a row, before the sensor is set up again
_WAITING, _SETUP, _SAMPLING = const(0), const(1), const(2)
_CAUSES = {110: wire.CAUSE_TIMEOUT}  # ETIMEDOUT
_LOST = const(1000)  # of a driver's OSError: with the cause, the sensor is lost


class Probe:
    def __init__(
        self,
        storage=None,
        *,
        id,
        firmware,
        board=wire.BOARD_MICROPYTHON,
        reset_cause=0,
        mhz=1,
        room=2048,
    ):
        now = ticks_us()
        self._settings = Settings(storage)
        self._link = Link(room)
        self._button = Button(now)
        self._streams = Streams(self._link, self._settings)
        self._raw = message(wire.RAW)
        self._hello = message(wire.HELLO)
        self._status = Status(mhz)
        self.supply = self._status.supply
        struct.pack_into("<16s", self._hello, wire.HELLO_FIRMWARE, firmware.encode())
        self._hello[wire.HELLO_BOARD] = board
        struct.pack_into("<8s", self._hello, wire.HELLO_PROBE_ID, id_of(id))
        self._hello[wire.HELLO_RESET_CAUSE] = reset_cause
        self._equipment = Equipment()
        self.battery = self._equipment.battery
        self._driver = None
        self._recover = None
        self._phase = _WAITING
        self._since = now
        self._is_faulty = self._has_gap = False
        self._failed = self._edges = self._taken = 0
        self._stamp = now
        self._read = self._overruns = self._faults = self._recoveries = 0
        self._commands = self._token = self._result = 0
        self._value = (0, 0)
        self._uptime = 0
        self._has_told_hello = False
        self._second = self._stepped = now
        self._wants_reset = False
        self._save(now)
        self._tell_hello(now)

    def _save(self, now):
        if not self._settings.save():
            self.tell(wire.EVENT_SETTINGS_FAILED, wire.CAUSE_NONE, 0, now)

    # Sensor

    def attach(self, driver, i2c, ready, recover=None):
        """`driver`: of driver_lsm9ds0.py or driver_mpu9250.py, not yet begun."""
        self._driver = driver
        self._ready = ready.value
        self._recover = recover
        self._phase = _SETUP
        driver.begin(i2c)

    def edge(self, _pin):
        self._stamp = ticks_us()
        self._edges += 1

    def acquire(self):
        """One step of the sensor: of its set-up, or the next sample. True where there
        was a sample.
        """
        if self._driver is None:
            return False
        now = ticks_us()
        try:
            if self._phase == _SAMPLING:
                return self._take_sample(now)
            if self._phase == _SETUP:
                self._set_up(now)
            elif ticks_diff(now, self._since) >= _RETRY_US:
                self._phase = _SETUP
                self._driver.begin()
        except OSError as error:
            self._fail(error, now)
        return False

    def _set_up(self, now):
        driver = self._driver
        if not driver.set_up(now):
            return
        self._phase = _SAMPLING
        self._since = now
        self._failed = 0
        self._taken = self._edges
        driver.describe(self._hello)
        self._streams.rate_hz = driver.rate_hz
        if self._is_faulty:
            self._is_faulty = False
            self._recoveries += 1
            self.tell(wire.EVENT_BUS_RECOVERED, wire.CAUSE_NONE, self._recoveries, now)
        self._tell_hello(now)
        if self._ready():
            # The age of a reading that already waits is unknown.
            driver.read(self._raw)

    def _take_sample(self, now):
        waiting = self._edges - self._taken
        if not waiting:
            silent_us = ticks_diff(now, self._since)
            if silent_us >= _SILENCE_US:
                self._lose(wire.CAUSE_NO_DATA_READY, 0, now)
            elif (self._failed or silent_us >= _MISSED_US) and self._ready():
                # What was not read in time keeps data-ready from rising again.
                self._driver.read(self._raw)
                if not self._failed:
                    self._overrun(1, now)
            return False
        stamp = self._stamp
        self._taken += waiting
        raw = self._raw
        if not self._driver.read(raw):
            raise OSError(5)  # EIO: bytes that are no reading
        self._failed = 0
        self._since = now
        self._read += 1
        if waiting > 1:
            self._overrun(waiting - 1, now)
        if self._has_gap:
            self._has_gap = False
            raw[wire.RAW_SAMPLE_FLAGS] |= wire.SAMPLE_GAP
        self._streams.take(raw, stamp)
        self._status.worked(ticks_diff(ticks_us(), now))
        return True

    def _overrun(self, missed, now):
        self._overruns += missed
        self._has_gap = True
        self.tell(wire.EVENT_OVERRUN, wire.CAUSE_LATE, missed, now)

    def _fail(self, error, now):
        """A transfer failed: one sample is lost or, too often, the sensor."""
        number = error.args[0] if error.args else 0
        if number > _LOST:
            self._lose(number - _LOST, self._driver.detail, now)
            return
        self._failed += 1
        cause = _CAUSES.get(number, wire.CAUSE_NACK)
        is_free = self._recover is None or self._recover()
        if not is_free:
            cause = wire.CAUSE_STUCK_BUS
        self._tell_fault(wire.EVENT_BUS_FAULT, cause, self._failed, now)
        if not is_free or self._phase == _SETUP or self._failed >= _FAILED_MAX:
            self._give_up(now)

    def _tell_fault(self, event, cause, detail, now):
        self._faults += 1
        self._has_gap = True
        self.tell(event, cause, detail, now)

    def _lose(self, cause, detail, now):
        self._tell_fault(wire.EVENT_SENSOR_FAULT, cause, detail, now)
        self._give_up(now)

    def _give_up(self, now):
        self._is_faulty = True
        self._phase = _WAITING
        self._since = now

    # Messages

    def tell(self, event, cause, detail, now=None):
        content = message(wire.EVENT)
        content[wire.EVENT_EVENT] = event
        content[wire.EVENT_CAUSE] = cause
        struct.pack_into("<i", content, wire.EVENT_DETAIL, detail)
        self._link.put(content, len(wire.EVENT), ticks_us() if now is None else now)

    def _tell_hello(self, now):
        hello = self._hello
        struct.pack_into("<H", hello, wire.HELLO_BOOT_COUNT, self._settings.boots)
        struct.pack_into("<H", hello, wire.HELLO_RAW_RATE, self._streams.rate())
        poses = self._settings.pose_rate
        struct.pack_into("<H", hello, wire.HELLO_POSE_RATE, poses)
        self._link.put(hello, len(wire.HELLO), now)

    def _tell_status(self, now):
        seen = self._uptime, self._edges, self._read, 0, self._overruns
        counts = self._faults, self._recoveries, self._commands
        raw = self._raw
        self._status.put(self._link, now, self._state(), seen, counts, raw)
        self._equipment.put(self._link, now)

    def _state(self):
        if self._is_faulty:
            return wire.STATE_FAULT
        return wire.STATE_STREAMING if self._streams.is_on else wire.STATE_IDLE

    # The wire, and steps

    def receive(self, stream):
        """Obeys the commands among the bytes that are there."""
        while True:
            command = self._link.receive(stream)
            if command is None:
                return
            now = ticks_us()
            self._commands += 1
            (token,) = struct.unpack_from("<H", command, wire.COMMAND_TOKEN)
            if token == 0 or token != self._token:
                self._token = token
                values = struct.unpack_from("<ii", command, wire.COMMAND_ARGUMENTS)
                order = command[wire.COMMAND_COMMAND]
                self._result, self._value = self._obey(order, values, now)
            self._reply(command[wire.COMMAND_COMMAND], token, now)

    def _obey(self, order, values, now):
        """The result of a command and its values."""
        if order in (wire.COMMAND_START, wire.COMMAND_STOP):
            self._stream(order == wire.COMMAND_START, wire.CAUSE_COMMAND, now)
        elif order == wire.COMMAND_HELLO:
            self._tell_hello(now)
        elif order == wire.COMMAND_RATE:
            return self._set_rate(values, now)
        elif order == wire.COMMAND_FIELDS:
            if values[0] != self._streams.fields:
                return wire.RESULT_BAD_ARGUMENT, (self._streams.fields, 0)
        elif order == wire.COMMAND_RESET:
            self._wants_reset = True
        elif order == wire.COMMAND_PARAMS_TELL:
            self._link.put(message(wire.PARAMS), len(wire.PARAMS), now)
        elif order != wire.COMMAND_TIME:
            return wire.RESULT_UNKNOWN_COMMAND, values
        return wire.RESULT_OK, values

    def _set_rate(self, values, now):
        settings, (stream, hz) = self._settings, values
        if stream not in (0, 1) or not is_rate(hz):
            rate = settings.rate if stream == 1 else settings.pose_rate
            return wire.RESULT_BAD_ARGUMENT, (stream, rate)
        if stream == 1:
            settings.rate = hz
        else:
            settings.pose_rate = hz
        self._save(now)
        return wire.RESULT_OK, values

    def _reply(self, order, token, now):
        content = message(wire.REPLY)
        content[wire.REPLY_REPLIED_COMMAND] = order
        struct.pack_into("<H", content, wire.REPLY_REPLIED_TOKEN, token)
        content[wire.REPLY_RESULT] = self._result
        struct.pack_into("<ii", content, wire.REPLY_VALUE, *self._value)
        self._link.put(content, len(wire.REPLY), now)

    def _stream(self, is_on, cause, now):
        if is_on is self._streams.is_on:
            return
        self._streams.is_on = is_on
        event = wire.EVENT_STREAM_STARTED if is_on else wire.EVENT_STREAM_STOPPED
        self.tell(event, cause, 0, now)

    def send(self, stream):
        """Writes what waits; returns how many bytes wait still."""
        return self._link.send(stream)

    def step(self, is_down):
        """Every 5 ms the button and the periodic messages; returns what the LED
        shows.
        """
        now = ticks_us()
        if ticks_diff(now, self._stepped) >= _STEP_US:
            self._stepped = now
            if self._button.step(is_down, now):
                self._click(now)
            elapsed_us = ticks_diff(now, self._second)
            if elapsed_us >= _SECOND_US:
                self._second = ticks_add(self._second, _SECOND_US)
                self._uptime += 1
                self._has_told_hello = False
                self._tell_status(now)
            elif elapsed_us >= _HELLO_US and not self._has_told_hello:
                self._has_told_hello = True
                self._tell_hello(now)
        return self._light(now)

    def _click(self, now):
        if self._button.is_down:
            self.tell(wire.EVENT_BUTTON_PRESSED, wire.CAUSE_BUTTON, 0, now)
            return
        self.tell(wire.EVENT_BUTTON_RELEASED, wire.CAUSE_BUTTON, 0, now)
        self._stream(not self._streams.is_on, wire.CAUSE_BUTTON, now)

    def _light(self, now):
        """Idle: a flash every second; fault: four; streaming: on."""
        if self._is_faulty:
            return (now >> 17) & 1 == 0
        return self._streams.is_on or (now >> 15) & 31 == 0

    def wants_reset(self):
        return self._wants_reset
