// SPDX-License-Identifier: MIT
// @ts-check
// The plots that there are: what each shows, from which history, in which unit.

/**
 * @typedef {object} Plot
 * @property {string} id
 * @property {string} title
 * @property {string} unit
 * @property {"pose" | "raw"} source
 * @property {[name: string, column: string, colour: string][]} series
 * @property {boolean} [isAngle] its values jump at 180 degrees
 * @property {boolean} [isFromZero]
 */

/** @type {readonly Plot[]} */
export const PLOTS = [
  {
    id: "attitude",
    title: "Attitude",
    unit: "°",
    source: "pose",
    isAngle: true,
    series: [
      ["yaw", "yaw_deg", "axis-z"],
      ["pitch", "pitch_deg", "axis-y"],
      ["roll", "roll_deg", "axis-x"],
    ],
  },
  {
    id: "sigma",
    title: "Stated errors, one sigma",
    unit: "°",
    source: "pose",
    isFromZero: true,
    series: [
      ["tilt", "tilt_sigma_deg", "axis-y"],
      ["heading", "heading_sigma_deg", "axis-z"],
    ],
  },
  {
    id: "acc",
    title: "Acceleration",
    unit: "m/s²",
    source: "raw",
    series: [
      ["x", "acc_x_m_s2", "axis-x"],
      ["y", "acc_y_m_s2", "axis-y"],
      ["z", "acc_z_m_s2", "axis-z"],
    ],
  },
  {
    id: "gyr",
    title: "Angular rate",
    unit: "°/s",
    source: "raw",
    series: [
      ["x", "gyr_x_deg_s", "axis-x"],
      ["y", "gyr_y_deg_s", "axis-y"],
      ["z", "gyr_z_deg_s", "axis-z"],
    ],
  },
  {
    id: "mag",
    title: "Magnetic field",
    unit: "µT",
    source: "raw",
    series: [
      ["x", "mag_x_uT", "axis-x"],
      ["y", "mag_y_uT", "axis-y"],
      ["z", "mag_z_uT", "axis-z"],
    ],
  },
  {
    id: "pitch",
    title: "Pitch",
    unit: "°",
    source: "raw",
    isAngle: true,
    series: [
      ["fused", "fused_pitch_deg", "accent"],
      ["acc. alone", "acc_pitch_deg", "warn"],
      ["gyro alone", "gyr_pitch_deg", "fourth"],
    ],
  },
  {
    id: "roll",
    title: "Roll",
    unit: "°",
    source: "raw",
    isAngle: true,
    series: [
      ["fused", "fused_roll_deg", "accent"],
      ["acc. alone", "acc_roll_deg", "warn"],
      ["gyro alone", "gyr_roll_deg", "fourth"],
    ],
  },
  {
    id: "pi-error",
    title: "PI error, Baranek",
    unit: "sine",
    source: "raw",
    series: [
      ["x", "pi_error_x", "axis-x"],
      ["y", "pi_error_y", "axis-y"],
    ],
  },
  {
    id: "pi-output",
    title: "PI output, Baranek",
    unit: "°/s",
    source: "raw",
    series: [
      ["x", "pi_offset_x_deg_s", "axis-x"],
      ["y", "pi_offset_y_deg_s", "axis-y"],
    ],
  },
  {
    id: "temperature",
    title: "Temperature",
    unit: "°C",
    source: "raw",
    series: [["sensor", "temperature_c", "axis-x"]],
  },
  {
    id: "delay",
    title: "Age",
    unit: "ms",
    source: "pose",
    isFromZero: true,
    series: [
      ["at the daemon", "age_ms", "axis-y"],
      ["at this page", "latency_ms", "axis-z"],
    ],
  },
];

/** The plots shown at first. */
export const FIRST = ["attitude", "sigma", "delay"];
