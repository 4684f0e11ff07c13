// SPDX-License-Identifier: MIT
// @ts-check
// The wire as data, and the daemon's words and limits for what it reads there.
// Generated from schema.toml by protocol/generate.py.

/**
 * @typedef {object} Field a wire number by `divide`, or times `times`, is in its unit
 * @property {string} name
 * @property {number} tag
 * @property {string} type
 * @property {number} count
 * @property {number} [divide]
 * @property {number} [times]
 * @property {number} [null] in all values: not available
 * @property {Record<string, string>} [names] of an enum
 * @property {[number, string][]} [bits] of flags
 */
/** @typedef {{ name: string, fields: Field[] }} Kind */
/**
 * @typedef {object} Argument
 * @property {string} name
 * @property {string} type
 * @property {Record<string, number>} choices
 * @property {boolean} isOptional
 */
/** @typedef {{ number: number, usage: string, arguments: Argument[] }} Command */

export const FINGERPRINT = 3738860123;

export const SEED = 31323;

export const HELLO_SEED = 65535;

/** @type {Record<string, Kind>} */
export const MESSAGES = {
  "3": {"name": "hello", "fields": [{"name": "protocol_version", "tag": 1, "type": "u8", "count": 1}, {"name": "schema_fingerprint", "tag": 2, "type": "u32", "count": 1}, {"name": "firmware", "tag": 3, "type": "text", "count": 16}, {"name": "board", "tag": 4, "type": "u8", "count": 1, "names": {"1": "nano", "2": "f405", "3": "micropython", "4": "pico", "5": "mega"}}, {"name": "probe_id", "tag": 5, "type": "bytes", "count": 8}, {"name": "sensor", "tag": 6, "type": "u8", "count": 1, "names": {"0": "none", "1": "mpu9250", "2": "mpu6500", "3": "lsm9ds0", "4": "lsm6dsox", "5": "lsm6dsv16x"}}, {"name": "who_am_i", "tag": 7, "type": "u8", "count": 2}, {"name": "mag_adjust", "tag": 8, "type": "u8", "count": 3}, {"name": "self_test", "tag": 9, "type": "u8", "count": 1, "bits": [[1, "acc_passed"], [2, "gyr_passed"], [4, "mag_passed"], [8, "host_judges"], [16, "acc_failed"], [32, "gyr_failed"], [64, "mag_failed"]]}, {"name": "sample_rate", "tag": 10, "type": "u16", "count": 1}, {"name": "pose_rate", "tag": 11, "type": "u16", "count": 1}, {"name": "raw_rate", "tag": 12, "type": "u16", "count": 1}, {"name": "acc_lsb", "tag": 13, "type": "u32", "count": 1, "divide": 1000000000}, {"name": "gyr_lsb", "tag": 14, "type": "u32", "count": 1, "divide": 1000000000}, {"name": "mag_lsb", "tag": 15, "type": "u32", "count": 1, "divide": 1000000}, {"name": "boot_count", "tag": 16, "type": "u16", "count": 1}, {"name": "reset_cause", "tag": 17, "type": "u8", "count": 1, "bits": [[1, "power_on"], [2, "external"], [4, "brown_out"], [8, "watchdog"], [16, "software"], [32, "hard_fault"]]}, {"name": "filter", "tag": 18, "type": "u8", "count": 1, "names": {"0": "none", "1": "fuse", "2": "complementary", "3": "mahony", "4": "madgwick", "5": "dcm_pi"}}, {"name": "reset_address", "tag": 19, "type": "u32", "count": 1}, {"name": "params_digest", "tag": 113, "type": "u32", "count": 1}, {"name": "own_field", "tag": 114, "type": "i16", "count": 3, "divide": 4}, {"name": "own_sigma", "tag": 115, "type": "u16", "count": 1, "divide": 4}]},
  "5": {"name": "raw", "fields": [{"name": "acc", "tag": 20, "type": "i16", "count": 3}, {"name": "gyr", "tag": 21, "type": "i16", "count": 3}, {"name": "mag", "tag": 22, "type": "i16", "count": 3, "null": -32768}, {"name": "temperature", "tag": 23, "type": "i16", "count": 1, "divide": 100, "null": -32768}, {"name": "sample_flags", "tag": 24, "type": "u8", "count": 1, "bits": [[1, "mag_overflow"], [2, "acc_clipped"], [4, "gyr_clipped"], [8, "gap"]]}]},
  "6": {"name": "pose", "fields": [{"name": "q", "tag": 30, "type": "i32", "count": 4, "divide": 1073741824}, {"name": "position", "tag": 31, "type": "i32", "count": 3, "divide": 1000000, "null": -2147483648}, {"name": "normal", "tag": 32, "type": "i16", "count": 3, "divide": 16384, "null": -32768}, {"name": "tilt_sigma", "tag": 33, "type": "u16", "count": 1, "divide": 100, "null": 65535}, {"name": "heading_sigma", "tag": 34, "type": "u16", "count": 1, "divide": 100, "null": 65535}, {"name": "pose_flags", "tag": 35, "type": "u16", "count": 1, "bits": [[1, "starting"], [2, "uncalibrated"], [4, "at_rest"], [8, "mag_disturbed"], [16, "mag_absent"], [32, "clipped"], [64, "heading_free"], [128, "gap"], [256, "tared"], [512, "field_impossible"], [1024, "field_unlike"], [2048, "force_impossible"], [4096, "mag_off"]]}]},
  "9": {"name": "event", "fields": [{"name": "event", "tag": 40, "type": "u8", "count": 1, "names": {"1": "stream_started", "2": "stream_stopped", "3": "button_pressed", "4": "button_released", "5": "bus_fault", "6": "bus_recovered", "7": "overrun", "8": "calibration_done", "9": "calibration_refused", "10": "sensor_fault", "11": "settings_restored", "12": "tared", "13": "settings_failed", "14": "restarted", "15": "clock_failed", "16": "card_ready", "17": "card_fault", "18": "card_full", "19": "log_started", "20": "log_ended", "21": "battery_low", "22": "going_to_sleep", "23": "radio_connected", "24": "radio_dropped", "25": "radio_fault", "26": "params_changed", "27": "params_lost", "28": "hook_failed", "29": "data_ready_polled"}}, {"name": "cause", "tag": 41, "type": "u8", "count": 1, "names": {"0": "none", "1": "button", "2": "command", "3": "boot", "4": "nack", "5": "timeout", "6": "stuck_bus", "7": "no_data_ready", "8": "wrong_chip", "9": "motion", "10": "late", "12": "crystal", "13": "absent", "14": "unprepared", "15": "rejected", "16": "worn", "17": "full", "18": "battery", "19": "registers", "20": "force", "21": "mag_silent", "22": "mag_stuck"}}, {"name": "detail", "tag": 42, "type": "i32", "count": 1}]},
  "10": {"name": "status", "fields": [{"name": "uptime", "tag": 50, "type": "u32", "count": 1}, {"name": "state", "tag": 51, "type": "u8", "count": 1, "names": {"0": "idle", "1": "calibrating", "2": "streaming", "3": "fault"}}, {"name": "samples_ready", "tag": 52, "type": "u32", "count": 1}, {"name": "samples_read", "tag": 53, "type": "u32", "count": 1}, {"name": "samples_fused", "tag": 54, "type": "u32", "count": 1}, {"name": "overruns", "tag": 55, "type": "u32", "count": 1}, {"name": "bus_faults", "tag": 56, "type": "u16", "count": 1}, {"name": "bus_recoveries", "tag": 57, "type": "u16", "count": 1}, {"name": "messages_sent", "tag": 58, "type": "u32", "count": 1}, {"name": "messages_dropped", "tag": 59, "type": "u32", "count": 1}, {"name": "commands_received", "tag": 60, "type": "u16", "count": 1}, {"name": "commands_bad", "tag": 61, "type": "u16", "count": 1}, {"name": "cycles_mean", "tag": 62, "type": "u32", "count": 1}, {"name": "cycles_worst", "tag": 63, "type": "u32", "count": 1}, {"name": "stack_free", "tag": 64, "type": "u16", "count": 1, "null": 65535}, {"name": "supply", "tag": 65, "type": "u16", "count": 1, "null": 65535}, {"name": "receive_lost", "tag": 66, "type": "u16", "count": 1}, {"name": "temperature", "tag": 67, "type": "i16", "count": 1, "divide": 100, "null": -32768}]},
  "17": {"name": "equipment", "fields": [{"name": "clock", "tag": 100, "type": "u8", "count": 1, "names": {"0": "none", "1": "crystal", "2": "spare"}}, {"name": "battery", "tag": 101, "type": "u16", "count": 1, "null": 65535}, {"name": "power", "tag": 102, "type": "u8", "count": 1, "bits": [[1, "external"], [2, "charging"], [4, "low"]]}, {"name": "radio", "tag": 103, "type": "u8", "count": 1, "names": {"0": "none", "1": "cable", "2": "configuring", "3": "waiting", "4": "connected", "5": "failed"}}, {"name": "radio_resets", "tag": 104, "type": "u16", "count": 1}, {"name": "card", "tag": 105, "type": "u8", "count": 1, "names": {"0": "none", "1": "absent", "2": "starting", "3": "unprepared", "4": "ready", "5": "logging", "6": "full", "7": "failed"}}, {"name": "card_block", "tag": 106, "type": "u32", "count": 1}, {"name": "card_blocks", "tag": 107, "type": "u32", "count": 1}, {"name": "card_faults", "tag": 108, "type": "u16", "count": 1}, {"name": "card_busy", "tag": 109, "type": "u16", "count": 1}, {"name": "recording", "tag": 110, "type": "u16", "count": 1}, {"name": "messages_logged", "tag": 111, "type": "u32", "count": 1}, {"name": "messages_unlogged", "tag": 112, "type": "u32", "count": 1}]},
  "18": {"name": "params", "fields": [{"name": "set_digest", "tag": 120, "type": "u32", "count": 1}, {"name": "set_length", "tag": 121, "type": "u16", "count": 1}, {"name": "part_offset", "tag": 122, "type": "u16", "count": 1}, {"name": "part", "tag": 123, "type": "bytes", "count": 28}]},
  "20": {"name": "stroke", "fields": [{"name": "stroke", "tag": 130, "type": "u16", "count": 1}, {"name": "end", "tag": 131, "type": "u8", "count": 1, "names": {"0": "running", "1": "rest", "2": "button", "3": "moving", "4": "too_long", "5": "clipped", "6": "gap", "7": "too_fast", "8": "lost", "9": "no_rest", "10": "too_near", "11": "no_filter", "12": "changed"}}, {"name": "windows", "tag": 132, "type": "u8", "count": 1}, {"name": "displacement", "tag": 133, "type": "i32", "count": 3, "divide": 1000000, "null": -2147483648}, {"name": "displacement_sigma", "tag": 134, "type": "u16", "count": 2, "divide": 100000, "null": 65535}, {"name": "path", "tag": 135, "type": "i32", "count": 3, "divide": 1000000, "null": -2147483648}, {"name": "path_sigma", "tag": 136, "type": "u16", "count": 2, "divide": 100000, "null": 65535}, {"name": "stroke_flags", "tag": 137, "type": "u16", "count": 1, "bits": [[1, "starting"], [2, "uncalibrated"], [4, "at_rest"], [8, "mag_disturbed"], [16, "mag_absent"], [32, "clipped"], [64, "heading_free"], [128, "gap"], [256, "tared"], [512, "field_impossible"], [1024, "field_unlike"], [2048, "force_impossible"], [4096, "mag_off"]]}]},
  "23": {"name": "self_test", "fields": [{"name": "before", "tag": 140, "type": "i16", "count": 6}, {"name": "stimulated", "tag": 141, "type": "i16", "count": 6}, {"name": "after", "tag": 142, "type": "i16", "count": 6}, {"name": "factory", "tag": 143, "type": "u8", "count": 6}, {"name": "mag_response", "tag": 144, "type": "i16", "count": 3}]},
  "12": {"name": "command", "fields": [{"name": "command", "tag": 70, "type": "u8", "count": 1, "names": {"1": "start", "2": "stop", "3": "rate", "4": "fields", "5": "hello", "6": "tare", "7": "reset", "8": "restart", "9": "time", "10": "params_write", "11": "params_apply", "12": "params_tell"}}, {"name": "token", "tag": 71, "type": "u16", "count": 1}, {"name": "arguments", "tag": 72, "type": "i32", "count": 2}]},
  "15": {"name": "reply", "fields": [{"name": "replied_command", "tag": 80, "type": "u8", "count": 1, "names": {"1": "start", "2": "stop", "3": "rate", "4": "fields", "5": "hello", "6": "tare", "7": "reset", "8": "restart", "9": "time", "10": "params_write", "11": "params_apply", "12": "params_tell"}}, {"name": "replied_token", "tag": 81, "type": "u16", "count": 1}, {"name": "result", "tag": 82, "type": "u8", "count": 1, "names": {"0": "ok", "1": "unknown_command", "2": "bad_argument", "3": "not_ready", "4": "busy", "5": "damaged", "6": "refused", "7": "failed"}}, {"name": "value", "tag": 83, "type": "i32", "count": 2}]},
};

/** @type {Record<string, Kind>} */
export const RECORDS = {
  "1": {"name": "acc", "fields": [{"name": "bias", "tag": 0, "type": "i32", "count": 3, "divide": 16384}, {"name": "matrix", "tag": 0, "type": "i16", "count": 9, "divide": 16384}, {"name": "sigma", "tag": 0, "type": "u16", "count": 1, "divide": 10000, "null": 65535}, {"name": "residual", "tag": 0, "type": "u16", "count": 1, "divide": 10000, "null": 65535}, {"name": "temperature", "tag": 0, "type": "i16", "count": 1, "divide": 100, "null": -32768}, {"name": "day", "tag": 0, "type": "u16", "count": 1, "null": 65535}, {"name": "method", "tag": 0, "type": "u8", "count": 1, "names": {"0": "unknown", "1": "guided", "2": "positions", "3": "extremes", "4": "wave", "5": "learned", "6": "dimple", "7": "sphere", "8": "measured", "9": "typed"}}, {"name": "drift", "tag": 0, "type": "u8", "count": 1, "divide": 12800, "null": 94}]},
  "2": {"name": "gyr", "fields": [{"name": "bias", "tag": 0, "type": "i32", "count": 3, "divide": 16384}, {"name": "matrix", "tag": 0, "type": "i16", "count": 9, "divide": 16384}, {"name": "sigma", "tag": 0, "type": "u16", "count": 1, "divide": 100000, "null": 65535}, {"name": "residual", "tag": 0, "type": "u16", "count": 1, "divide": 100000, "null": 65535}, {"name": "temperature", "tag": 0, "type": "i16", "count": 1, "divide": 100, "null": -32768}, {"name": "day", "tag": 0, "type": "u16", "count": 1, "null": 65535}, {"name": "method", "tag": 0, "type": "u8", "count": 1, "names": {"0": "unknown", "1": "guided", "2": "positions", "3": "extremes", "4": "wave", "5": "learned", "6": "dimple", "7": "sphere", "8": "measured", "9": "typed"}}]},
  "3": {"name": "mag", "fields": [{"name": "bias", "tag": 0, "type": "i32", "count": 3, "divide": 16384}, {"name": "matrix", "tag": 0, "type": "i16", "count": 9, "divide": 16384}, {"name": "sigma", "tag": 0, "type": "u16", "count": 1, "divide": 100, "null": 65535}, {"name": "residual", "tag": 0, "type": "u16", "count": 1, "divide": 100, "null": 65535}, {"name": "temperature", "tag": 0, "type": "i16", "count": 1, "divide": 100, "null": -32768}, {"name": "day", "tag": 0, "type": "u16", "count": 1, "null": 65535}, {"name": "method", "tag": 0, "type": "u8", "count": 1, "names": {"0": "unknown", "1": "guided", "2": "positions", "3": "extremes", "4": "wave", "5": "learned", "6": "dimple", "7": "sphere", "8": "measured", "9": "typed"}}, {"name": "norm", "tag": 0, "type": "u16", "count": 1, "divide": 100, "null": 65535}, {"name": "dip", "tag": 0, "type": "i16", "count": 1, "divide": 100, "null": -32768}, {"name": "lag", "tag": 0, "type": "i16", "count": 1, "divide": 1000000, "null": -32768}, {"name": "north", "tag": 0, "type": "i16", "count": 1, "divide": 4, "null": -32768}, {"name": "up", "tag": 0, "type": "i16", "count": 1, "divide": 4, "null": -32768}]},
  "4": {"name": "tip", "fields": [{"name": "offset", "tag": 0, "type": "i32", "count": 3, "divide": 1000000, "null": -2147483648}, {"name": "axis", "tag": 0, "type": "i16", "count": 3, "divide": 16384, "null": -32768}, {"name": "sigma", "tag": 0, "type": "u16", "count": 1, "divide": 100000, "null": 65535}, {"name": "day", "tag": 0, "type": "u16", "count": 1, "null": 65535}, {"name": "method", "tag": 0, "type": "u8", "count": 1, "names": {"0": "unknown", "1": "guided", "2": "positions", "3": "extremes", "4": "wave", "5": "learned", "6": "dimple", "7": "sphere", "8": "measured", "9": "typed"}}]},
  "5": {"name": "options", "fields": [{"name": "button_does", "tag": 0, "type": "u8", "count": 1, "names": {"0": "stream", "1": "tell", "2": "stroke"}}, {"name": "reference", "tag": 0, "type": "u8", "count": 1, "names": {"0": "none", "1": "heading", "2": "full"}}]},
  "6": {"name": "name", "fields": [{"name": "text", "tag": 0, "type": "u8", "count": 24}]},
  "8": {"name": "noise", "fields": [{"name": "acc", "tag": 0, "type": "u16", "count": 1, "divide": 1000000, "null": 65535}, {"name": "gyr", "tag": 0, "type": "u16", "count": 1, "divide": 10000000, "null": 65535}]},
};

/** @type {Record<string, Record<string, string>>} */
export const PUBLISHED = {
  "pose": {"q": "q", "position_m": "position", "normal": "normal", "tilt_sigma_deg": "tilt_sigma", "heading_sigma_deg": "heading_sigma", "flags": "pose_flags"},
  "stroke": {"stroke": "stroke", "end": "end", "windows": "windows", "displacement_m": "displacement", "displacement_sigma_m": "displacement_sigma", "path_m": "path", "path_sigma_m": "path_sigma", "flags": "stroke_flags"},
  "raw": {"temperature_c": "temperature", "acc_counts": "acc", "gyr_counts": "gyr", "mag_counts": "mag", "flags": "sample_flags"},
  "event": {"event": "event", "cause": "cause", "detail": "detail"},
};

/** @type {Record<string, Command>} */
export const COMMANDS = {
  "start": {"number": 1, "usage": "start needs ", "arguments": []},
  "stop": {"number": 2, "usage": "stop needs ", "arguments": []},
  "rate": {"number": 3, "usage": "rate needs stream=pose or raw, and hz=a number", "arguments": [{"name": "stream", "type": "choice", "choices": {"pose": 0, "raw": 1}, "isOptional": false}, {"name": "hz", "type": "integer", "choices": {}, "isOptional": false}]},
  "fields": {"number": 4, "usage": "fields needs streams=pose,raw or one of them", "arguments": [{"name": "streams", "type": "list", "choices": {"pose": 0, "raw": 1}, "isOptional": false}]},
  "hello": {"number": 5, "usage": "hello needs ", "arguments": []},
  "tare": {"number": 6, "usage": "tare needs what=all, heading or undo", "arguments": [{"name": "what", "type": "choice", "choices": {"all": 0, "heading": 1, "undo": 2}, "isOptional": true}]},
  "reset": {"number": 7, "usage": "reset needs ", "arguments": []},
  "restart": {"number": 8, "usage": "restart needs filter=fuse, complementary, mahony, madgwick, dcm_pi, or nothing; forget=0 or 1", "arguments": [{"name": "filter", "type": "choice", "choices": {"fuse": 1, "complementary": 2, "mahony": 3, "madgwick": 4, "dcm_pi": 5}, "isOptional": true}, {"name": "forget", "type": "choice", "choices": {"0": 0, "1": 1}, "isOptional": true}]},
  "time": {"number": 9, "usage": "time needs ", "arguments": []},
  "params_tell": {"number": 12, "usage": "params_tell needs ", "arguments": []},
};

/** @type {Record<string, string>} */
export const STROKE_ADVICE = {
  "moving": "hold it still before and after",
  "too_long": "end it within 5 s",
  "clipped": "move it more gently",
  "gap": "samples are missing: run imud check",
  "too_fast": "move it more slowly",
  "lost": "lay it still first",
  "no_rest": "lay it still first",
  "too_near": "wait half a second between presses",
  "no_filter": "run imud restart --filter fuse",
  "changed": "the params have changed: press again",
};

export const WITHHELD = {
  "tilt": {"force_impossible": "the accelerometer does not measure gravity: switch the probe off and on; if that does not help, its sensor is defective", "starting": "it is still levelling; wait a few seconds"},
  "heading": {"force_impossible": "the accelerometer does not measure gravity: switch the probe off and on; if that does not help, its sensor is defective", "mag_off": "the magnetometer is switched off: imud magnetometer PROBE on", "mag_absent": "no magnetometer, or one with a constant reading", "field_impossible": "the magnetic field can't be the Earth's: remove the magnet, or move away from steel", "field_unlike": "the magnetic field differs from that of its calibration: turn it about each axis once; if that does not help, remove the magnet", "starting": "it is still learning the local magnetic field; wait a few seconds", "heading_free": "its own magnetic field is not known well enough yet: turn it about each axis once more"},
};

export const NO_ERRORS = "the filter that runs states no errors";

export const PASSING = ["it is still learning the local magnetic field; wait a few seconds", "it is still levelling; wait a few seconds", "the filter that runs states no errors"];

/** @type {Record<string, number[]>} */
export const SUPPLY_MV = {
  "nano": [4300, 5500, 3780],
  "mega": [4500, 5500, 4050],
  "f405": [3000, 3600, 2400],
  "pico": [2300, 5500, 1800],
};

export const WARM_DEGC = [5.0, 60.0];

export const SPECIFIED_DEGC = [-40.0, 85.0];
