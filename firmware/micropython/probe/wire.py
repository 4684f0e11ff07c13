# SPDX-License-Identifier: MIT
"""The wire as numbers, for a probe without the C module. Of each message the content,
with its id, its tags and what is not available in place; of each field where its value
begins, counted from the id.

Generated from schema.toml by protocol/generate.py.
"""

from micropython import const

SEED = const(0x7A5B)  # of the CRC of all messages but hello
HELLO_SEED = const(0xFFFF)

# protocol_version, schema_fingerprint, firmware, board, probe_id, sensor, who_am_i,
# mag_adjust, self_test, sample_rate, pose_rate, raw_rate, acc_lsb, gyr_lsb, mag_lsb,
# boot_count, reset_cause, filter, reset_address, params_digest, own_field, own_sigma
HELLO = (
    b"\x03\x00\x00\x00\x00\x00\x00\x00\x00\x01\x01\x02\x5b\x7a\xda\xde"
    b"\x03\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"
    b"\x00\x04\x00\x05\x00\x00\x00\x00\x00\x00\x00\x00\x06\x00\x07\x00"
    b"\x00\x08\x00\x00\x00\x09\x00\x0a\x00\x00\x0b\x00\x00\x0c\x00\x00"
    b"\x0d\x00\x00\x00\x00\x0e\x00\x00\x00\x00\x0f\x00\x00\x00\x00\x10"
    b"\x00\x00\x11\x00\x12\x00\x13\x00\x00\x00\x00\x71\x00\x00\x00\x00"
    b"\x72\x00\x00\x00\x00\x00\x00\x73\x00\x00"
)
HELLO_PROTOCOL_VERSION = const(10)
HELLO_SCHEMA_FINGERPRINT = const(12)
HELLO_FIRMWARE = const(17)
HELLO_BOARD = const(34)
HELLO_PROBE_ID = const(36)
HELLO_SENSOR = const(45)
HELLO_WHO_AM_I = const(47)
HELLO_MAG_ADJUST = const(50)
HELLO_SELF_TEST = const(54)
HELLO_SAMPLE_RATE = const(56)
HELLO_POSE_RATE = const(59)
HELLO_RAW_RATE = const(62)
HELLO_ACC_LSB = const(65)
HELLO_GYR_LSB = const(70)
HELLO_MAG_LSB = const(75)
HELLO_BOOT_COUNT = const(80)
HELLO_RESET_CAUSE = const(83)
HELLO_FILTER = const(85)
HELLO_RESET_ADDRESS = const(87)
HELLO_PARAMS_DIGEST = const(92)
HELLO_OWN_FIELD = const(97)
HELLO_OWN_SIGMA = const(104)

# acc, gyr, mag, temperature, sample_flags
RAW = (
    b"\x05\x00\x00\x00\x00\x00\x00\x00\x00\x14\x00\x00\x00\x00\x00\x00"
    b"\x15\x00\x00\x00\x00\x00\x00\x16\x00\x80\x00\x80\x00\x80\x17\x00"
    b"\x80\x18\x00"
)
RAW_ACC = const(10)
RAW_GYR = const(17)
RAW_MAG = const(24)
RAW_TEMPERATURE = const(31)
RAW_SAMPLE_FLAGS = const(34)

# event, cause, detail
EVENT = b"\x09\x00\x00\x00\x00\x00\x00\x00\x00\x28\x00\x29\x00\x2a\x00\x00\x00\x00"
EVENT_EVENT = const(10)
EVENT_CAUSE = const(12)
EVENT_DETAIL = const(14)

# uptime, state, samples_ready, samples_read, samples_fused, overruns, bus_faults,
# bus_recoveries, messages_sent, messages_dropped, commands_received, commands_bad,
# cycles_mean, cycles_worst, stack_free, supply, receive_lost, temperature
STATUS = (
    b"\x0a\x00\x00\x00\x00\x00\x00\x00\x00\x32\x00\x00\x00\x00\x33\x00"
    b"\x34\x00\x00\x00\x00\x35\x00\x00\x00\x00\x36\x00\x00\x00\x00\x37"
    b"\x00\x00\x00\x00\x38\x00\x00\x39\x00\x00\x3a\x00\x00\x00\x00\x3b"
    b"\x00\x00\x00\x00\x3c\x00\x00\x3d\x00\x00\x3e\x00\x00\x00\x00\x3f"
    b"\x00\x00\x00\x00\x40\xff\xff\x41\xff\xff\x42\x00\x00\x43\x00\x80"
)
STATUS_UPTIME = const(10)
STATUS_STATE = const(15)
STATUS_SAMPLES_READY = const(17)
STATUS_SAMPLES_READ = const(22)
STATUS_SAMPLES_FUSED = const(27)
STATUS_OVERRUNS = const(32)
STATUS_BUS_FAULTS = const(37)
STATUS_BUS_RECOVERIES = const(40)
STATUS_MESSAGES_SENT = const(43)
STATUS_MESSAGES_DROPPED = const(48)
STATUS_COMMANDS_RECEIVED = const(53)
STATUS_COMMANDS_BAD = const(56)
STATUS_CYCLES_MEAN = const(59)
STATUS_CYCLES_WORST = const(64)
STATUS_STACK_FREE = const(69)
STATUS_SUPPLY = const(72)
STATUS_RECEIVE_LOST = const(75)
STATUS_TEMPERATURE = const(78)

# clock, battery, power, radio, radio_resets, card, card_block, card_blocks,
# card_faults, card_busy, recording, messages_logged, messages_unlogged
EQUIPMENT = (
    b"\x11\x00\x00\x00\x00\x00\x00\x00\x00\x64\x00\x65\xff\xff\x66\x00"
    b"\x67\x00\x68\x00\x00\x69\x00\x6a\x00\x00\x00\x00\x6b\x00\x00\x00"
    b"\x00\x6c\x00\x00\x6d\x00\x00\x6e\x00\x00\x6f\x00\x00\x00\x00\x70"
    b"\x00\x00\x00\x00"
)
EQUIPMENT_CLOCK = const(10)
EQUIPMENT_BATTERY = const(12)
EQUIPMENT_POWER = const(15)
EQUIPMENT_RADIO = const(17)
EQUIPMENT_RADIO_RESETS = const(19)
EQUIPMENT_CARD = const(22)
EQUIPMENT_CARD_BLOCK = const(24)
EQUIPMENT_CARD_BLOCKS = const(29)
EQUIPMENT_CARD_FAULTS = const(34)
EQUIPMENT_CARD_BUSY = const(37)
EQUIPMENT_RECORDING = const(40)
EQUIPMENT_MESSAGES_LOGGED = const(43)
EQUIPMENT_MESSAGES_UNLOGGED = const(48)

# set_digest, set_length, part_offset, part
PARAMS = (
    b"\x12\x00\x00\x00\x00\x00\x00\x00\x00\x78\x00\x00\x00\x00\x79\x00"
    b"\x00\x7a\x00\x00\x7b\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"
    b"\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"
    b"\x00"
)
PARAMS_SET_DIGEST = const(10)
PARAMS_SET_LENGTH = const(15)
PARAMS_PART_OFFSET = const(18)
PARAMS_PART = const(21)

# command, token, arguments
COMMAND = (
    b"\x0c\x00\x00\x00\x00\x00\x00\x00\x00\x46\x00\x47\x00\x00\x48\x00"
    b"\x00\x00\x00\x00\x00\x00\x00"
)
COMMAND_COMMAND = const(10)
COMMAND_TOKEN = const(12)
COMMAND_ARGUMENTS = const(15)

# replied_command, replied_token, result, value
REPLY = (
    b"\x0f\x00\x00\x00\x00\x00\x00\x00\x00\x50\x00\x51\x00\x00\x52\x00"
    b"\x53\x00\x00\x00\x00\x00\x00\x00\x00"
)
REPLY_REPLIED_COMMAND = const(10)
REPLY_REPLIED_TOKEN = const(12)
REPLY_RESULT = const(15)
REPLY_VALUE = const(17)

COMMAND_START = const(1)
COMMAND_STOP = const(2)
COMMAND_RATE = const(3)
COMMAND_FIELDS = const(4)
COMMAND_HELLO = const(5)
COMMAND_TARE = const(6)
COMMAND_RESET = const(7)
COMMAND_RESTART = const(8)
COMMAND_TIME = const(9)
COMMAND_PARAMS_WRITE = const(10)
COMMAND_PARAMS_APPLY = const(11)
COMMAND_PARAMS_TELL = const(12)

EVENT_STREAM_STARTED = const(1)
EVENT_STREAM_STOPPED = const(2)
EVENT_BUTTON_PRESSED = const(3)
EVENT_BUTTON_RELEASED = const(4)
EVENT_BUS_FAULT = const(5)
EVENT_BUS_RECOVERED = const(6)
EVENT_OVERRUN = const(7)
EVENT_CALIBRATION_DONE = const(8)
EVENT_CALIBRATION_REFUSED = const(9)
EVENT_SENSOR_FAULT = const(10)
EVENT_SETTINGS_RESTORED = const(11)
EVENT_TARED = const(12)
EVENT_SETTINGS_FAILED = const(13)
EVENT_RESTARTED = const(14)
EVENT_CLOCK_FAILED = const(15)
EVENT_CARD_READY = const(16)
EVENT_CARD_FAULT = const(17)
EVENT_CARD_FULL = const(18)
EVENT_LOG_STARTED = const(19)
EVENT_LOG_ENDED = const(20)
EVENT_BATTERY_LOW = const(21)
EVENT_GOING_TO_SLEEP = const(22)
EVENT_RADIO_CONNECTED = const(23)
EVENT_RADIO_DROPPED = const(24)
EVENT_RADIO_FAULT = const(25)
EVENT_PARAMS_CHANGED = const(26)
EVENT_PARAMS_LOST = const(27)
EVENT_HOOK_FAILED = const(28)
EVENT_DATA_READY_POLLED = const(29)

CAUSE_NONE = const(0)
CAUSE_BUTTON = const(1)
CAUSE_COMMAND = const(2)
CAUSE_BOOT = const(3)
CAUSE_NACK = const(4)
CAUSE_TIMEOUT = const(5)
CAUSE_STUCK_BUS = const(6)
CAUSE_NO_DATA_READY = const(7)
CAUSE_WRONG_CHIP = const(8)
CAUSE_MOTION = const(9)
CAUSE_LATE = const(10)
CAUSE_CRYSTAL = const(12)
CAUSE_ABSENT = const(13)
CAUSE_UNPREPARED = const(14)
CAUSE_REJECTED = const(15)
CAUSE_WORN = const(16)
CAUSE_FULL = const(17)
CAUSE_BATTERY = const(18)
CAUSE_REGISTERS = const(19)
CAUSE_FORCE = const(20)
CAUSE_MAG_SILENT = const(21)
CAUSE_MAG_STUCK = const(22)

RESULT_OK = const(0)
RESULT_UNKNOWN_COMMAND = const(1)
RESULT_BAD_ARGUMENT = const(2)
RESULT_NOT_READY = const(3)
RESULT_BUSY = const(4)
RESULT_DAMAGED = const(5)
RESULT_REFUSED = const(6)
RESULT_FAILED = const(7)

STATE_IDLE = const(0)
STATE_CALIBRATING = const(1)
STATE_STREAMING = const(2)
STATE_FAULT = const(3)

SENSOR_NONE = const(0)
SENSOR_MPU9250 = const(1)
SENSOR_MPU6500 = const(2)
SENSOR_LSM9DS0 = const(3)
SENSOR_LSM6DSOX = const(4)
SENSOR_LSM6DSV16X = const(5)

BOARD_NANO = const(1)
BOARD_F405 = const(2)
BOARD_MICROPYTHON = const(3)
BOARD_PICO = const(4)
BOARD_MEGA = const(5)

SAMPLE_MAG_OVERFLOW = const(1)
SAMPLE_ACC_CLIPPED = const(2)
SAMPLE_GYR_CLIPPED = const(4)
SAMPLE_GAP = const(8)

STREAM_POSE = const(1)
STREAM_RAW = const(2)

POWER_EXTERNAL = const(1)
POWER_CHARGING = const(2)
POWER_LOW = const(4)
