# SPDX-License-Identifier: MIT
"""The wire as data: what schema.toml says, for messages.py to work from.

Generated from schema.toml by protocol/generate.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Literal

PROTOCOL_VERSION = 1
FINGERPRINT = 0xDEDA7A5B
SEED = 0x7A5B  # of the CRC of all messages but hello
HELLO_SEED = 0xFFFF
HEADER = "<BII"  # id, sequence, time_us


class Board(IntEnum):
    NANO = 1
    F405 = 2
    MICROPYTHON = 3
    PICO = 4
    MEGA = 5


class Sensor(IntEnum):
    NONE = 0
    MPU9250 = 1
    MPU6500 = 2
    LSM9DS0 = 3
    LSM6DSOX = 4
    LSM6DSV16X = 5


class State(IntEnum):
    IDLE = 0
    CALIBRATING = 1
    STREAMING = 2
    FAULT = 3


class Event(IntEnum):
    STREAM_STARTED = 1
    STREAM_STOPPED = 2
    BUTTON_PRESSED = 3
    BUTTON_RELEASED = 4
    BUS_FAULT = 5
    BUS_RECOVERED = 6
    OVERRUN = 7
    CALIBRATION_DONE = 8
    CALIBRATION_REFUSED = 9
    SENSOR_FAULT = 10
    SETTINGS_RESTORED = 11
    TARED = 12
    SETTINGS_FAILED = 13
    RESTARTED = 14
    CLOCK_FAILED = 15
    CARD_READY = 16
    CARD_FAULT = 17
    CARD_FULL = 18
    LOG_STARTED = 19
    LOG_ENDED = 20
    BATTERY_LOW = 21
    GOING_TO_SLEEP = 22
    RADIO_CONNECTED = 23
    RADIO_DROPPED = 24
    RADIO_FAULT = 25
    PARAMS_CHANGED = 26
    PARAMS_LOST = 27
    HOOK_FAILED = 28
    DATA_READY_POLLED = 29


class Cause(IntEnum):
    NONE = 0
    BUTTON = 1
    COMMAND = 2
    BOOT = 3
    NACK = 4
    TIMEOUT = 5
    STUCK_BUS = 6
    NO_DATA_READY = 7
    WRONG_CHIP = 8
    MOTION = 9
    LATE = 10
    CRYSTAL = 12
    ABSENT = 13
    UNPREPARED = 14
    REJECTED = 15
    WORN = 16
    FULL = 17
    BATTERY = 18
    REGISTERS = 19
    FORCE = 20
    MAG_SILENT = 21
    MAG_STUCK = 22


class Clock(IntEnum):
    NONE = 0
    CRYSTAL = 1
    SPARE = 2


class Radio(IntEnum):
    NONE = 0
    CABLE = 1
    CONFIGURING = 2
    WAITING = 3
    CONNECTED = 4
    FAILED = 5


class Card(IntEnum):
    NONE = 0
    ABSENT = 1
    STARTING = 2
    UNPREPARED = 3
    READY = 4
    LOGGING = 5
    FULL = 6
    FAILED = 7


class Command(IntEnum):
    START = 1
    STOP = 2
    RATE = 3
    FIELDS = 4
    HELLO = 5
    TARE = 6
    RESET = 7
    RESTART = 8
    TIME = 9
    PARAMS_WRITE = 10
    PARAMS_APPLY = 11
    PARAMS_TELL = 12


class Result(IntEnum):
    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    NOT_READY = 3
    BUSY = 4
    DAMAGED = 5
    REFUSED = 6
    FAILED = 7


class Filter(IntEnum):
    NONE = 0
    FUSE = 1
    COMPLEMENTARY = 2
    MAHONY = 3
    MADGWICK = 4
    DCM_PI = 5


class Method(IntEnum):
    UNKNOWN = 0
    GUIDED = 1
    POSITIONS = 2
    EXTREMES = 3
    WAVE = 4
    LEARNED = 5
    DIMPLE = 6
    SPHERE = 7
    MEASURED = 8
    TYPED = 9


class ButtonDoes(IntEnum):
    STREAM = 0
    TELL = 1
    STROKE = 2


class Reference(IntEnum):
    NONE = 0
    HEADING = 1
    FULL = 2


class StrokeEnd(IntEnum):
    RUNNING = 0
    REST = 1
    BUTTON = 2
    MOVING = 3
    TOO_LONG = 4
    CLIPPED = 5
    GAP = 6
    TOO_FAST = 7
    LOST = 8
    NO_REST = 9
    TOO_NEAR = 10
    NO_FILTER = 11
    CHANGED = 12


class ResetCauseFlags(IntFlag):
    POWER_ON = 1 << 0
    EXTERNAL = 1 << 1
    BROWN_OUT = 1 << 2
    WATCHDOG = 1 << 3
    SOFTWARE = 1 << 4
    HARD_FAULT = 1 << 5


class SelfTestFlags(IntFlag):
    ACC_PASSED = 1 << 0
    GYR_PASSED = 1 << 1
    MAG_PASSED = 1 << 2
    HOST_JUDGES = 1 << 3
    ACC_FAILED = 1 << 4
    GYR_FAILED = 1 << 5
    MAG_FAILED = 1 << 6


class SampleFlags(IntFlag):
    MAG_OVERFLOW = 1 << 0
    ACC_CLIPPED = 1 << 1
    GYR_CLIPPED = 1 << 2
    GAP = 1 << 3


class PoseFlags(IntFlag):
    STARTING = 1 << 0
    UNCALIBRATED = 1 << 1
    AT_REST = 1 << 2
    MAG_DISTURBED = 1 << 3
    MAG_ABSENT = 1 << 4
    CLIPPED = 1 << 5
    HEADING_FREE = 1 << 6
    GAP = 1 << 7
    TARED = 1 << 8
    FIELD_IMPOSSIBLE = 1 << 9
    FIELD_UNLIKE = 1 << 10
    FORCE_IMPOSSIBLE = 1 << 11
    MAG_OFF = 1 << 12


class PowerFlags(IntFlag):
    EXTERNAL = 1 << 0
    CHARGING = 1 << 1
    LOW = 1 << 2


class StreamFlags(IntFlag):
    POSE = 1 << 0
    RAW = 1 << 1


# Field has a member `type`, inside which the builtin is out of reach.
Enums = type[IntEnum]
Flags = type[IntFlag]

# The struct code of one value.
CODES = {
    "u8": "B",
    "i8": "b",
    "u16": "H",
    "i16": "h",
    "u32": "I",
    "i32": "i",
    "text": "s",
    "bytes": "s",
}


@dataclass(frozen=True, slots=True)
class Field:
    """A field; a wire number times `scale` is in `unit`."""

    name: str
    tag: int
    type: str
    count: int = 1
    scale: float = 1.0
    unit: str = ""
    null: int | None = None  # the wire number, in all values, for "not available"
    enum: Enums | None = None
    flags: Flags | None = None
    format: Literal["", "hex"] = ""

    @property
    def code(self) -> str:
        """The struct code of all its values, such as "3h" or "16s"."""
        return f"{self.count}{CODES[self.type]}"


@dataclass(frozen=True, slots=True)
class MessageType:
    name: str
    id: int
    direction: Literal["probe", "host"]
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class RecordType:
    """A record of the params; its parts are fields without a tag (0)."""

    name: str
    tag: int
    parts: tuple[Field, ...]


MESSAGES = (
    MessageType(
        "hello",
        0x03,
        "probe",
        (
            Field("protocol_version", 1, "u8"),
            Field("schema_fingerprint", 2, "u32", format="hex"),
            Field("firmware", 3, "text", 16),
            Field("board", 4, "u8", enum=Board),
            Field("probe_id", 5, "bytes", 8),
            Field("sensor", 6, "u8", enum=Sensor),
            Field("who_am_i", 7, "u8", 2, format="hex"),
            Field("mag_adjust", 8, "u8", 3),
            Field("self_test", 9, "u8", flags=SelfTestFlags),
            Field("sample_rate", 10, "u16", unit="Hz"),
            Field("pose_rate", 11, "u16", unit="Hz"),
            Field("raw_rate", 12, "u16", unit="Hz"),
            Field("acc_lsb", 13, "u32", scale=1e-9, unit="m/s2"),
            Field("gyr_lsb", 14, "u32", scale=1e-9, unit="rad/s"),
            Field("mag_lsb", 15, "u32", scale=1e-6, unit="uT"),
            Field("boot_count", 16, "u16"),
            Field("reset_cause", 17, "u8", flags=ResetCauseFlags),
            Field("filter", 18, "u8", enum=Filter),
            Field("reset_address", 19, "u32", format="hex"),
            Field("params_digest", 113, "u32", format="hex"),
            Field("own_field", 114, "i16", 3, scale=0.25, unit="uT"),
            Field("own_sigma", 115, "u16", scale=0.25, unit="uT"),
        ),
    ),
    MessageType(
        "raw",
        0x05,
        "probe",
        (
            Field("acc", 20, "i16", 3, unit="counts"),
            Field("gyr", 21, "i16", 3, unit="counts"),
            Field("mag", 22, "i16", 3, unit="counts", null=-32768),
            Field("temperature", 23, "i16", scale=0.01, unit="degC", null=-32768),
            Field("sample_flags", 24, "u8", flags=SampleFlags),
        ),
    ),
    MessageType(
        "pose",
        0x06,
        "probe",
        (
            Field("q", 30, "i32", 4, scale=2.0**-30),
            Field("position", 31, "i32", 3, scale=1e-6, unit="m", null=-2147483648),
            Field("normal", 32, "i16", 3, scale=2.0**-14, null=-32768),
            Field("tilt_sigma", 33, "u16", scale=0.01, unit="deg", null=65535),
            Field("heading_sigma", 34, "u16", scale=0.01, unit="deg", null=65535),
            Field("pose_flags", 35, "u16", flags=PoseFlags),
        ),
    ),
    MessageType(
        "event",
        0x09,
        "probe",
        (
            Field("event", 40, "u8", enum=Event),
            Field("cause", 41, "u8", enum=Cause),
            Field("detail", 42, "i32"),
        ),
    ),
    MessageType(
        "status",
        0x0A,
        "probe",
        (
            Field("uptime", 50, "u32", unit="s"),
            Field("state", 51, "u8", enum=State),
            Field("samples_ready", 52, "u32"),
            Field("samples_read", 53, "u32"),
            Field("samples_fused", 54, "u32"),
            Field("overruns", 55, "u32"),
            Field("bus_faults", 56, "u16"),
            Field("bus_recoveries", 57, "u16"),
            Field("messages_sent", 58, "u32"),
            Field("messages_dropped", 59, "u32"),
            Field("commands_received", 60, "u16"),
            Field("commands_bad", 61, "u16"),
            Field("cycles_mean", 62, "u32"),
            Field("cycles_worst", 63, "u32"),
            Field("stack_free", 64, "u16", unit="bytes", null=65535),
            Field("supply", 65, "u16", unit="mV", null=65535),
            Field("receive_lost", 66, "u16"),
            Field("temperature", 67, "i16", scale=0.01, unit="degC", null=-32768),
        ),
    ),
    MessageType(
        "equipment",
        0x11,
        "probe",
        (
            Field("clock", 100, "u8", enum=Clock),
            Field("battery", 101, "u16", unit="mV", null=65535),
            Field("power", 102, "u8", flags=PowerFlags),
            Field("radio", 103, "u8", enum=Radio),
            Field("radio_resets", 104, "u16"),
            Field("card", 105, "u8", enum=Card),
            Field("card_block", 106, "u32"),
            Field("card_blocks", 107, "u32"),
            Field("card_faults", 108, "u16"),
            Field("card_busy", 109, "u16", unit="ms"),
            Field("recording", 110, "u16"),
            Field("messages_logged", 111, "u32"),
            Field("messages_unlogged", 112, "u32"),
        ),
    ),
    MessageType(
        "params",
        0x12,
        "probe",
        (
            Field("set_digest", 120, "u32", format="hex"),
            Field("set_length", 121, "u16"),
            Field("part_offset", 122, "u16"),
            Field("part", 123, "bytes", 28),
        ),
    ),
    MessageType(
        "stroke",
        0x14,
        "probe",
        (
            Field("stroke", 130, "u16"),
            Field("end", 131, "u8", enum=StrokeEnd),
            Field("windows", 132, "u8"),
            Field(
                "displacement", 133, "i32", 3, scale=1e-6, unit="m", null=-2147483648
            ),
            Field(
                "displacement_sigma", 134, "u16", 2, scale=1e-5, unit="m", null=65535
            ),
            Field("path", 135, "i32", 3, scale=1e-6, unit="m", null=-2147483648),
            Field("path_sigma", 136, "u16", 2, scale=1e-5, unit="m", null=65535),
            Field("stroke_flags", 137, "u16", flags=PoseFlags),
        ),
    ),
    MessageType(
        "self_test",
        0x17,
        "probe",
        (
            Field("before", 140, "i16", 6, unit="counts"),
            Field("stimulated", 141, "i16", 6, unit="counts"),
            Field("after", 142, "i16", 6, unit="counts"),
            Field("factory", 143, "u8", 6),
            Field("mag_response", 144, "i16", 3, unit="counts"),
        ),
    ),
    MessageType(
        "command",
        0x0C,
        "host",
        (
            Field("command", 70, "u8", enum=Command),
            Field("token", 71, "u16"),
            Field("arguments", 72, "i32", 2),
        ),
    ),
    MessageType(
        "reply",
        0x0F,
        "probe",
        (
            Field("replied_command", 80, "u8", enum=Command),
            Field("replied_token", 81, "u16"),
            Field("result", 82, "u8", enum=Result),
            Field("value", 83, "i32", 2),
        ),
    ),
)

RECORDS = (
    RecordType(
        "acc",
        1,
        (
            Field("bias", 0, "i32", 3, scale=2.0**-14, unit="counts"),
            Field("matrix", 0, "i16", 9, scale=2.0**-14),
            Field("sigma", 0, "u16", scale=1e-4, unit="m/s2", null=65535),
            Field("residual", 0, "u16", scale=1e-4, unit="m/s2", null=65535),
            Field("temperature", 0, "i16", scale=0.01, unit="degC", null=-32768),
            Field("day", 0, "u16", unit="days", null=65535),
            Field("method", 0, "u8", enum=Method),
            Field("drift", 0, "u8", scale=78125e-9, unit="m/s2/K", null=94),
        ),
    ),
    RecordType(
        "gyr",
        2,
        (
            Field("bias", 0, "i32", 3, scale=2.0**-14, unit="counts"),
            Field("matrix", 0, "i16", 9, scale=2.0**-14),
            Field("sigma", 0, "u16", scale=1e-5, null=65535),
            Field("residual", 0, "u16", scale=1e-5, unit="rad", null=65535),
            Field("temperature", 0, "i16", scale=0.01, unit="degC", null=-32768),
            Field("day", 0, "u16", unit="days", null=65535),
            Field("method", 0, "u8", enum=Method),
        ),
    ),
    RecordType(
        "mag",
        3,
        (
            Field("bias", 0, "i32", 3, scale=2.0**-14, unit="counts"),
            Field("matrix", 0, "i16", 9, scale=2.0**-14),
            Field("sigma", 0, "u16", scale=0.01, unit="uT", null=65535),
            Field("residual", 0, "u16", scale=0.01, unit="uT", null=65535),
            Field("temperature", 0, "i16", scale=0.01, unit="degC", null=-32768),
            Field("day", 0, "u16", unit="days", null=65535),
            Field("method", 0, "u8", enum=Method),
            Field("norm", 0, "u16", scale=0.01, unit="uT", null=65535),
            Field("dip", 0, "i16", scale=0.01, unit="deg", null=-32768),
            Field("lag", 0, "i16", scale=1e-6, unit="s", null=-32768),
            Field("north", 0, "i16", scale=0.25, unit="uT", null=-32768),
            Field("up", 0, "i16", scale=0.25, unit="uT", null=-32768),
        ),
    ),
    RecordType(
        "tip",
        4,
        (
            Field("offset", 0, "i32", 3, scale=1e-6, unit="m", null=-2147483648),
            Field("axis", 0, "i16", 3, scale=2.0**-14, null=-32768),
            Field("sigma", 0, "u16", scale=1e-5, unit="m", null=65535),
            Field("day", 0, "u16", unit="days", null=65535),
            Field("method", 0, "u8", enum=Method),
        ),
    ),
    RecordType(
        "options",
        5,
        (
            Field("button_does", 0, "u8", enum=ButtonDoes),
            Field("reference", 0, "u8", enum=Reference),
        ),
    ),
    RecordType(
        "name",
        6,
        (Field("text", 0, "u8", 24),),
    ),
    RecordType(
        "noise",
        8,
        (
            Field("acc", 0, "u16", scale=1e-6, unit="m/s2/rtHz", null=65535),
            Field("gyr", 0, "u16", scale=1e-7, unit="rad/s/rtHz", null=65535),
        ),
    ),
)
