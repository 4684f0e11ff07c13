// SPDX-License-Identifier: MIT
// @ts-check
// Keeps the last ten minutes of the selected probe, and computes what figure 4 of
// Baranek's paper compares: the fused angles, those of the accelerometer alone, and those
// of the gyroscope alone.

import { POSE_NUMBERS } from "../published.js";
import {
  DEGREES,
  fromRotationVector,
  IDENTITY,
  multiply,
  normalized,
  toAngles,
} from "../rotation.js";
import { DcmPi } from "./baranek.js";
import { History } from "./history.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../rotation.js").Quat} Quat */

// The latest pose or sample may be this far from the other's time, s.
const TOGETHER_US = 100_000;
const NONE = /** @type {const} */ ([NaN, NaN, NaN]);

export const POSE_COLUMNS = [
  "yaw_deg",
  "pitch_deg",
  "roll_deg",
  ...POSE_NUMBERS,
  "age_ms",
  "latency_ms",
];

export const RAW_COLUMNS = [
  "acc_x_m_s2",
  "acc_y_m_s2",
  "acc_z_m_s2",
  "gyr_x_deg_s",
  "gyr_y_deg_s",
  "gyr_z_deg_s",
  "mag_x_uT",
  "mag_y_uT",
  "mag_z_uT",
  "temperature_c",
  "acc_pitch_deg",
  "acc_roll_deg",
  "gyr_pitch_deg",
  "gyr_roll_deg",
  "fused_pitch_deg",
  "fused_roll_deg",
  "pi_error_x",
  "pi_error_y",
  "pi_offset_x_deg_s",
  "pi_offset_y_deg_s",
];

/** Follows one probe. */
export class Recorder {
  /** @param {import("../link.js").Link} link */
  constructor(link) {
    this._link = link;
    /** @type {import("../rotation.js").Convention} */
    this.convention = "nautical";
    this.pose = new History(POSE_COLUMNS);
    this.raw = new History(RAW_COLUMNS);
    this._mag = [...NONE];
    /** @type {Quat | null} */
    this._gyro = null;
    this._rawUs = 0;
    this._pi = new DcmPi();
    /** @type {Quat} */
    this._fused = IDENTITY;
    this._fusedUs = -Infinity;
  }

  /** The time of the last value, s; 0: there is none. */
  get last() {
    return Math.max(this.pose.last || 0, this.raw.last || 0);
  }

  /** Restarts: for another probe or another convention of angles. */
  clear() {
    this.pose.clear();
    this.raw.clear();
    this._gyro = null;
    this._pi = new DcmPi();
    this._fusedUs = -Infinity;
  }

  /**
   * Sets the convention of the fused angles; those in another are forgotten.
   * @param {import("../rotation.js").Convention} convention
   */
  setConvention(convention) {
    if (convention !== this.convention) {
      this.convention = convention;
      this.pose.clear();
    }
  }

  /** Begins the gyroscope's own angles at the fused ones. */
  restartGyro() {
    this._gyro = null;
  }

  /** @param {Line} line */
  take(line) {
    if (line.type === "pose") {
      this._takePose(line);
    } else if (line.type === "raw") {
      this._takeRaw(line);
    }
  }

  /** @param {Line} line */
  _takePose(line) {
    const { yaw, pitch, roll } = toAngles(line.q, this.convention);
    this._fused = line.q;
    this._fusedUs = line.t_device_us;
    const latency = Date.now() + this._link.aheadMs - line.t_ns / 1e6;
    this.pose.add(timeOf(line), [
      yaw,
      pitch,
      roll,
      ...POSE_NUMBERS.map((name) => line[name] ?? NaN),
      line.age_us === null ? NaN : line.age_us / 1000,
      line.t_bound_us === null ? NaN : Math.max(0, latency),
    ]);
  }

  /** @param {Line} line */
  _takeRaw(line) {
    const acc = line.acc_m_s2 ?? NONE;
    const gyr = line.gyr_rad_s ?? NONE;
    if (line.mag_uT !== null) {
      this._mag = line.mag_uT; // it comes less often than the others
    }
    const isFresh = Math.abs(line.t_device_us - this._fusedUs) < TOGETHER_US;
    const seconds = (line.t_device_us - this._rawUs) / 1e6;
    if (seconds > 0 && seconds < 1 && line.acc_m_s2 && line.gyr_rad_s) {
      this._pi.step(gyr, acc, seconds);
    } else {
      this._pi = new DcmPi();
    }
    this._turn(gyr, line.t_device_us, isFresh);
    const none = { yaw: NaN, pitch: NaN, roll: NaN };
    const turned = this._gyro === null ? none : toAngles(this._gyro, "nautical");
    const fused = isFresh ? toAngles(this._fused, "nautical") : none;
    this.raw.add(timeOf(line), [
      ...acc,
      ...gyr.map((/** @type {number} */ rate) => rate * DEGREES),
      ...this._mag,
      line.temperature_c ?? NaN,
      Math.atan2(-acc[0], Math.hypot(acc[1], acc[2])) * DEGREES,
      Math.atan2(acc[1], acc[2]) * DEGREES,
      turned.pitch,
      turned.roll,
      fused.pitch,
      fused.roll,
      ...this._pi.error,
      ...this._pi.offset.map((rate) => rate * DEGREES),
    ]);
  }

  /**
   * Turns the gyroscope's own attitude by a sample.
   * @param {readonly [number, number, number]} gyr rad/s
   * @param {number} timeUs
   * @param {boolean} isFresh there is a fused pose to begin with
   */
  _turn([x, y, z], timeUs, isFresh) {
    const seconds = (timeUs - this._rawUs) / 1e6;
    this._rawUs = timeUs;
    if (this._gyro === null || seconds <= 0 || seconds > 1 || Number.isNaN(x)) {
      this._gyro = isFresh ? this._fused : null;
      return;
    }
    const turn = fromRotationVector([x * seconds, y * seconds, z * seconds]);
    this._gyro = normalized(multiply(this._gyro, turn));
  }
}

/** @param {Line} line */
function timeOf(line) {
  return line.t_ns === null ? line.t_device_us / 1e6 : line.t_ns / 1e9;
}
