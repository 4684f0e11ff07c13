// SPDX-License-Identifier: MIT
// Messages to content bytes and back. Generated from schema.toml by
// protocol/generate.py; what each field means is in PROTOCOL.md.
#ifndef MESSAGES_H
#define MESSAGES_H

#include <stdbool.h>
#include <stdint.h>

#include "core/math/in_flash.h"

#define SCHEMA_FINGERPRINT 0xdeda7a5bu
#define SCHEMA_SEED 0x7a5bu  // CRC of all messages but hello

enum {
    PROTOCOL_VERSION = 1,
    MESSAGE_CONTENT_MAX = 106,  // the longest message
};

enum message_id {
    MESSAGE_HELLO = 0x03,
    MESSAGE_RAW = 0x05,
    MESSAGE_POSE = 0x06,
    MESSAGE_EVENT = 0x09,
    MESSAGE_STATUS = 0x0a,
    MESSAGE_EQUIPMENT = 0x11,
    MESSAGE_PARAMS = 0x12,
    MESSAGE_STROKE = 0x14,
    MESSAGE_SELF_TEST = 0x17,
    MESSAGE_COMMAND = 0x0c,
    MESSAGE_REPLY = 0x0f,
};

// Bytes of content.
enum {
    MESSAGE_HELLO_SIZE = 106,
    MESSAGE_RAW_SIZE = 35,
    MESSAGE_POSE_SIZE = 55,
    MESSAGE_EVENT_SIZE = 18,
    MESSAGE_STATUS_SIZE = 80,
    MESSAGE_EQUIPMENT_SIZE = 52,
    MESSAGE_PARAMS_SIZE = 49,
    MESSAGE_STROKE_SIZE = 55,
    MESSAGE_SELF_TEST_SIZE = 62,
    MESSAGE_COMMAND_SIZE = 23,
    MESSAGE_REPLY_SIZE = 25,
};

enum board {
    BOARD_NANO = 1,
    BOARD_F405 = 2,
    BOARD_MICROPYTHON = 3,
    BOARD_PICO = 4,
    BOARD_MEGA = 5,
};

enum sensor {
    SENSOR_NONE = 0,
    SENSOR_MPU9250 = 1,
    SENSOR_MPU6500 = 2,
    SENSOR_LSM9DS0 = 3,
    SENSOR_LSM6DSOX = 4,
    SENSOR_LSM6DSV16X = 5,
};

enum state {
    STATE_IDLE = 0,
    STATE_CALIBRATING = 1,
    STATE_STREAMING = 2,
    STATE_FAULT = 3,
};

enum event {
    EVENT_STREAM_STARTED = 1,
    EVENT_STREAM_STOPPED = 2,
    EVENT_BUTTON_PRESSED = 3,
    EVENT_BUTTON_RELEASED = 4,
    EVENT_BUS_FAULT = 5,
    EVENT_BUS_RECOVERED = 6,
    EVENT_OVERRUN = 7,
    EVENT_CALIBRATION_DONE = 8,
    EVENT_CALIBRATION_REFUSED = 9,
    EVENT_SENSOR_FAULT = 10,
    EVENT_SETTINGS_RESTORED = 11,
    EVENT_TARED = 12,
    EVENT_SETTINGS_FAILED = 13,
    EVENT_RESTARTED = 14,
    EVENT_CLOCK_FAILED = 15,
    EVENT_CARD_READY = 16,
    EVENT_CARD_FAULT = 17,
    EVENT_CARD_FULL = 18,
    EVENT_LOG_STARTED = 19,
    EVENT_LOG_ENDED = 20,
    EVENT_BATTERY_LOW = 21,
    EVENT_GOING_TO_SLEEP = 22,
    EVENT_RADIO_CONNECTED = 23,
    EVENT_RADIO_DROPPED = 24,
    EVENT_RADIO_FAULT = 25,
    EVENT_PARAMS_CHANGED = 26,
    EVENT_PARAMS_LOST = 27,
    EVENT_HOOK_FAILED = 28,
    EVENT_DATA_READY_POLLED = 29,
};

enum cause {
    CAUSE_NONE = 0,
    CAUSE_BUTTON = 1,
    CAUSE_COMMAND = 2,
    CAUSE_BOOT = 3,
    CAUSE_NACK = 4,
    CAUSE_TIMEOUT = 5,
    CAUSE_STUCK_BUS = 6,
    CAUSE_NO_DATA_READY = 7,
    CAUSE_WRONG_CHIP = 8,
    CAUSE_MOTION = 9,
    CAUSE_LATE = 10,
    CAUSE_CRYSTAL = 12,
    CAUSE_ABSENT = 13,
    CAUSE_UNPREPARED = 14,
    CAUSE_REJECTED = 15,
    CAUSE_WORN = 16,
    CAUSE_FULL = 17,
    CAUSE_BATTERY = 18,
    CAUSE_REGISTERS = 19,
    CAUSE_FORCE = 20,
    CAUSE_MAG_SILENT = 21,
    CAUSE_MAG_STUCK = 22,
};

enum clock {
    CLOCK_NONE = 0,
    CLOCK_CRYSTAL = 1,
    CLOCK_SPARE = 2,
};

enum radio {
    RADIO_NONE = 0,
    RADIO_CABLE = 1,
    RADIO_CONFIGURING = 2,
    RADIO_WAITING = 3,
    RADIO_CONNECTED = 4,
    RADIO_FAILED = 5,
};

enum card {
    CARD_NONE = 0,
    CARD_ABSENT = 1,
    CARD_STARTING = 2,
    CARD_UNPREPARED = 3,
    CARD_READY = 4,
    CARD_LOGGING = 5,
    CARD_FULL = 6,
    CARD_FAILED = 7,
};

enum command {
    COMMAND_START = 1,
    COMMAND_STOP = 2,
    COMMAND_RATE = 3,
    COMMAND_FIELDS = 4,
    COMMAND_HELLO = 5,
    COMMAND_TARE = 6,
    COMMAND_RESET = 7,
    COMMAND_RESTART = 8,
    COMMAND_TIME = 9,
    COMMAND_PARAMS_WRITE = 10,
    COMMAND_PARAMS_APPLY = 11,
    COMMAND_PARAMS_TELL = 12,
};

enum result {
    RESULT_OK = 0,
    RESULT_UNKNOWN_COMMAND = 1,
    RESULT_BAD_ARGUMENT = 2,
    RESULT_NOT_READY = 3,
    RESULT_BUSY = 4,
    RESULT_DAMAGED = 5,
    RESULT_REFUSED = 6,
    RESULT_FAILED = 7,
};

enum filter {
    FILTER_NONE = 0,
    FILTER_FUSE = 1,
    FILTER_COMPLEMENTARY = 2,
    FILTER_MAHONY = 3,
    FILTER_MADGWICK = 4,
    FILTER_DCM_PI = 5,
};

enum method {
    METHOD_UNKNOWN = 0,
    METHOD_GUIDED = 1,
    METHOD_POSITIONS = 2,
    METHOD_EXTREMES = 3,
    METHOD_WAVE = 4,
    METHOD_LEARNED = 5,
    METHOD_DIMPLE = 6,
    METHOD_SPHERE = 7,
    METHOD_MEASURED = 8,
    METHOD_TYPED = 9,
};

enum button_does {
    BUTTON_DOES_STREAM = 0,
    BUTTON_DOES_TELL = 1,
    BUTTON_DOES_STROKE = 2,
};

enum reference {
    REFERENCE_NONE = 0,
    REFERENCE_HEADING = 1,
    REFERENCE_FULL = 2,
};

enum stroke_end {
    STROKE_END_RUNNING = 0,
    STROKE_END_REST = 1,
    STROKE_END_BUTTON = 2,
    STROKE_END_MOVING = 3,
    STROKE_END_TOO_LONG = 4,
    STROKE_END_CLIPPED = 5,
    STROKE_END_GAP = 6,
    STROKE_END_TOO_FAST = 7,
    STROKE_END_LOST = 8,
    STROKE_END_NO_REST = 9,
    STROKE_END_TOO_NEAR = 10,
    STROKE_END_NO_FILTER = 11,
    STROKE_END_CHANGED = 12,
};

enum {
    RESET_CAUSE_POWER_ON = 1u << 0,
    RESET_CAUSE_EXTERNAL = 1u << 1,
    RESET_CAUSE_BROWN_OUT = 1u << 2,
    RESET_CAUSE_WATCHDOG = 1u << 3,
    RESET_CAUSE_SOFTWARE = 1u << 4,
    RESET_CAUSE_HARD_FAULT = 1u << 5,
};

enum {
    SELF_TEST_ACC_PASSED = 1u << 0,
    SELF_TEST_GYR_PASSED = 1u << 1,
    SELF_TEST_MAG_PASSED = 1u << 2,
    SELF_TEST_HOST_JUDGES = 1u << 3,
    SELF_TEST_ACC_FAILED = 1u << 4,
    SELF_TEST_GYR_FAILED = 1u << 5,
    SELF_TEST_MAG_FAILED = 1u << 6,
};

enum {
    SAMPLE_MAG_OVERFLOW = 1u << 0,
    SAMPLE_ACC_CLIPPED = 1u << 1,
    SAMPLE_GYR_CLIPPED = 1u << 2,
    SAMPLE_GAP = 1u << 3,
};

enum {
    POSE_STARTING = 1u << 0,
    POSE_UNCALIBRATED = 1u << 1,
    POSE_AT_REST = 1u << 2,
    POSE_MAG_DISTURBED = 1u << 3,
    POSE_MAG_ABSENT = 1u << 4,
    POSE_CLIPPED = 1u << 5,
    POSE_HEADING_FREE = 1u << 6,
    POSE_GAP = 1u << 7,
    POSE_TARED = 1u << 8,
    POSE_FIELD_IMPOSSIBLE = 1u << 9,
    POSE_FIELD_UNLIKE = 1u << 10,
    POSE_FORCE_IMPOSSIBLE = 1u << 11,
    POSE_MAG_OFF = 1u << 12,
};

enum {
    POWER_EXTERNAL = 1u << 0,
    POWER_CHARGING = 1u << 1,
    POWER_LOW = 1u << 2,
};

enum {
    STREAM_POSE = 1u << 0,
    STREAM_RAW = 1u << 1,
};

// Wire numbers that say "not available", in every value of a field.
#define RAW_MAG_NULL INT16_MIN
#define RAW_TEMPERATURE_NULL INT16_MIN
#define POSE_POSITION_NULL INT32_MIN
#define POSE_NORMAL_NULL INT16_MIN
#define POSE_TILT_SIGMA_NULL UINT16_MAX
#define POSE_HEADING_SIGMA_NULL UINT16_MAX
#define STATUS_STACK_FREE_NULL UINT16_MAX
#define STATUS_SUPPLY_NULL UINT16_MAX
#define STATUS_TEMPERATURE_NULL INT16_MIN
#define EQUIPMENT_BATTERY_NULL UINT16_MAX
#define STROKE_DISPLACEMENT_NULL INT32_MIN
#define STROKE_DISPLACEMENT_SIGMA_NULL UINT16_MAX
#define STROKE_PATH_NULL INT32_MIN
#define STROKE_PATH_SIGMA_NULL UINT16_MAX

enum message_result {
    MESSAGE_OK = 0,
    MESSAGE_MISSING_FIELD = -1,
    MESSAGE_DOUBLED_FIELD = -2,
    MESSAGE_UNKNOWN_FIELD = -3,  // a tag that is not of this message
    MESSAGE_OUT_OF_ORDER = -4,
    MESSAGE_WRONG_LENGTH = -5,  // the content ends in its header or in a value
    MESSAGE_WRONG_ID = -6,
};

struct message_header {
    uint8_t id;
    uint32_t sequence;
    uint32_t time_us;
};

// encode() writes to `content` (the message's size) and returns the length.
// The message may be in the same buffer, behind the header and all tags.
// decode() leaves `header` and `out` untouched unless MESSAGE_OK. take() is
// as strict, says no more than true, and only then `out` is good. Its length
// is not 0.
//
// message_fill() encodes a message of any layout, but for the two numbers of
// its header: those lie at these offsets of the content.
enum { MESSAGE_SEQUENCE_AT = 1, MESSAGE_TIME_AT = 5 };
typedef const IN_FLASH uint8_t message_layout;
uint8_t message_fill(message_layout *layout, const void *message, uint8_t *content);

struct message_hello {
    uint8_t protocol_version;
    uint32_t schema_fingerprint;
    char firmware[16];
    uint8_t board;  // enum board
    uint8_t probe_id[8];
    uint8_t sensor;  // enum sensor
    uint8_t who_am_i[2];
    uint8_t mag_adjust[3];
    uint8_t self_test;     // SELF_TEST_ flags
    uint16_t sample_rate;  // Hz
    uint16_t pose_rate;    // Hz
    uint16_t raw_rate;     // Hz
    uint32_t acc_lsb;      // 1e-9 m/s2
    uint32_t gyr_lsb;      // 1e-9 rad/s
    uint32_t mag_lsb;      // 1e-6 uT
    uint16_t boot_count;
    uint8_t reset_cause;  // RESET_CAUSE_ flags
    uint8_t filter;       // enum filter
    uint32_t reset_address;
    uint32_t params_digest;
    int16_t own_field[3];  // 0.25 uT
    uint16_t own_sigma;    // 0.25 uT
};

uint8_t message_hello_encode(const struct message_hello *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content);
enum message_result message_hello_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_hello *out);
bool message_hello_take(const uint8_t *content, uint8_t length,
                        struct message_hello *out);
extern message_layout message_hello_layout[46];

struct message_raw {
    int16_t acc[3];        // counts
    int16_t gyr[3];        // counts
    int16_t mag[3];        // counts
    int16_t temperature;   // 0.01 degC
    uint8_t sample_flags;  // SAMPLE_ flags
};

uint8_t message_raw_encode(const struct message_raw *message, uint32_t sequence,
                           uint32_t time_us, uint8_t *content);
enum message_result message_raw_decode(const uint8_t *content, uint8_t length,
                                       struct message_header *header,
                                       struct message_raw *out);
bool message_raw_take(const uint8_t *content, uint8_t length, struct message_raw *out);
extern message_layout message_raw_layout[12];

struct message_pose {
    int32_t q[4];            // 2^-30
    int32_t position[3];     // 1e-6 m
    int16_t normal[3];       // 2^-14
    uint16_t tilt_sigma;     // 0.01 deg
    uint16_t heading_sigma;  // 0.01 deg
    uint16_t pose_flags;     // POSE_ flags
};

uint8_t message_pose_encode(const struct message_pose *message, uint32_t sequence,
                            uint32_t time_us, uint8_t *content);
enum message_result message_pose_decode(const uint8_t *content, uint8_t length,
                                        struct message_header *header,
                                        struct message_pose *out);
bool message_pose_take(const uint8_t *content, uint8_t length,
                       struct message_pose *out);
extern message_layout message_pose_layout[14];

struct message_event {
    uint8_t event;  // enum event
    uint8_t cause;  // enum cause
    int32_t detail;
};

uint8_t message_event_encode(const struct message_event *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content);
enum message_result message_event_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_event *out);
bool message_event_take(const uint8_t *content, uint8_t length,
                        struct message_event *out);
extern message_layout message_event_layout[8];

struct message_status {
    uint32_t uptime;  // s
    uint8_t state;    // enum state
    uint32_t samples_ready;
    uint32_t samples_read;
    uint32_t samples_fused;
    uint32_t overruns;
    uint16_t bus_faults;
    uint16_t bus_recoveries;
    uint32_t messages_sent;
    uint32_t messages_dropped;
    uint16_t commands_received;
    uint16_t commands_bad;
    uint32_t cycles_mean;
    uint32_t cycles_worst;
    uint16_t stack_free;  // bytes
    uint16_t supply;      // mV
    uint16_t receive_lost;
    int16_t temperature;  // 0.01 degC
};

uint8_t message_status_encode(const struct message_status *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content);
enum message_result message_status_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_status *out);
bool message_status_take(const uint8_t *content, uint8_t length,
                         struct message_status *out);
extern message_layout message_status_layout[38];

struct message_equipment {
    uint8_t clock;     // enum clock
    uint16_t battery;  // mV
    uint8_t power;     // POWER_ flags
    uint8_t radio;     // enum radio
    uint16_t radio_resets;
    uint8_t card;  // enum card
    uint32_t card_block;
    uint32_t card_blocks;
    uint16_t card_faults;
    uint16_t card_busy;  // ms
    uint16_t recording;
    uint32_t messages_logged;
    uint32_t messages_unlogged;
};

uint8_t message_equipment_encode(const struct message_equipment *message,
                                 uint32_t sequence, uint32_t time_us, uint8_t *content);
enum message_result message_equipment_decode(const uint8_t *content, uint8_t length,
                                             struct message_header *header,
                                             struct message_equipment *out);
bool message_equipment_take(const uint8_t *content, uint8_t length,
                            struct message_equipment *out);
extern message_layout message_equipment_layout[28];

struct message_params {
    uint32_t set_digest;
    uint16_t set_length;
    uint16_t part_offset;
    uint8_t part[28];
};

uint8_t message_params_encode(const struct message_params *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content);
enum message_result message_params_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_params *out);
bool message_params_take(const uint8_t *content, uint8_t length,
                         struct message_params *out);
extern message_layout message_params_layout[10];

struct message_stroke {
    uint16_t stroke;
    uint8_t end;  // enum stroke_end
    uint8_t windows;
    int32_t displacement[3];         // 1e-6 m
    uint16_t displacement_sigma[2];  // 1e-5 m
    int32_t path[3];                 // 1e-6 m
    uint16_t path_sigma[2];          // 1e-5 m
    uint16_t stroke_flags;           // POSE_ flags
};

uint8_t message_stroke_encode(const struct message_stroke *message, uint32_t sequence,
                              uint32_t time_us, uint8_t *content);
enum message_result message_stroke_decode(const uint8_t *content, uint8_t length,
                                          struct message_header *header,
                                          struct message_stroke *out);
bool message_stroke_take(const uint8_t *content, uint8_t length,
                         struct message_stroke *out);
extern message_layout message_stroke_layout[18];

struct message_self_test {
    int16_t before[6];      // counts
    int16_t stimulated[6];  // counts
    int16_t after[6];       // counts
    uint8_t factory[6];
    int16_t mag_response[3];  // counts
};

uint8_t message_self_test_encode(const struct message_self_test *message,
                                 uint32_t sequence, uint32_t time_us, uint8_t *content);
enum message_result message_self_test_decode(const uint8_t *content, uint8_t length,
                                             struct message_header *header,
                                             struct message_self_test *out);
bool message_self_test_take(const uint8_t *content, uint8_t length,
                            struct message_self_test *out);
extern message_layout message_self_test_layout[12];

struct message_command {
    uint8_t command;  // enum command
    uint16_t token;
    int32_t arguments[2];
};

uint8_t message_command_encode(const struct message_command *message, uint32_t sequence,
                               uint32_t time_us, uint8_t *content);
enum message_result message_command_decode(const uint8_t *content, uint8_t length,
                                           struct message_header *header,
                                           struct message_command *out);
bool message_command_take(const uint8_t *content, uint8_t length,
                          struct message_command *out);
extern message_layout message_command_layout[8];

struct message_reply {
    uint8_t replied_command;  // enum command
    uint16_t replied_token;
    uint8_t result;  // enum result
    int32_t value[2];
};

uint8_t message_reply_encode(const struct message_reply *message, uint32_t sequence,
                             uint32_t time_us, uint8_t *content);
enum message_result message_reply_decode(const uint8_t *content, uint8_t length,
                                         struct message_header *header,
                                         struct message_reply *out);
bool message_reply_take(const uint8_t *content, uint8_t length,
                        struct message_reply *out);
extern message_layout message_reply_layout[10];

#endif
