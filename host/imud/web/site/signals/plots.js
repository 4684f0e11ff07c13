// SPDX-License-Identifier: MIT
// @ts-check
// The plots that there are: what each shows, from which history, in which unit.

import { isAlone } from "../link.js";

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

/**
 * A vector along the three axes.
 * @type {(name: string, unit: string) => Plot["series"]}
 */
function threeAxes(name, unit) {
  return ["x", "y", "z"].map((axis) => [axis, `${name}_${axis}_${unit}`, `axis-${axis}`]);
}

/**
 * An angle as the filter has it, and as each sensor alone would.
 * @type {(angle: string) => Plot["series"]}
 */
function compared(angle) {
  return [
    ["fused", `fused_${angle}_deg`, "accent"],
    ["acc. alone", `acc_${angle}_deg`, "warn"],
    ["gyro alone", `gyr_${angle}_deg`, "fourth"],
  ];
}

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
    series: threeAxes("acc", "m_s2"),
  },
  {
    id: "gyr",
    title: "Angular rate",
    unit: "°/s",
    source: "raw",
    series: threeAxes("gyr", "deg_s"),
  },
  {
    id: "mag",
    title: "Magnetic field",
    unit: "µT",
    source: "raw",
    series: threeAxes("mag", "uT"),
  },
  {
    id: "pitch",
    title: "Pitch",
    unit: "°",
    source: "raw",
    isAngle: true,
    series: compared("pitch"),
  },
  {
    id: "roll",
    title: "Roll",
    unit: "°",
    source: "raw",
    isAngle: true,
    series: compared("roll"),
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
export const FIRST = ["attitude", "sigma", ...(isAlone ? [] : ["delay"])];
