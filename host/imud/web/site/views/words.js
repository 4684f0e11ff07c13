// SPDX-License-Identifier: MIT
// @ts-check
// States and flags in words, each with the colour that it is shown in.

/** @typedef {[words: string, kind: "good" | "warn" | "bad" | ""]} Words */

/** @type {Record<string, Words>} */
export const STATES = {
  streaming: ["streaming", "good"],
  idle: ["idle", ""],
  calibrating: ["calibrating", "warn"],
  fault: ["fault", "bad"],
  silent: ["silent", "bad"],
  gone: ["unplugged", "bad"],
  "other schema": ["other firmware", "bad"],
  unheard: ["no news from the daemon", "bad"],
  unknown: ["unknown", ""],
};

/** @type {Record<string, Words>} */
const FLAGS = {
  starting: ["settling", "warn"],
  uncalibrated: ["gyroscope not calibrated", "warn"],
  at_rest: ["at rest", ""],
  mag_disturbed: ["magnetic disturbance", "warn"],
  mag_absent: ["no magnetometer", "warn"],
  clipped: ["sensor at its limit", "bad"],
  heading_free: ["heading drifts", "warn"],
  gap: ["gap", "bad"],
  tared: ["own origin", ""],
  calibration_old: ["calibrated over a year ago", "warn"],
  calibration_temperature: ["calibrated at another temperature", "warn"],
};

/**
 * A flag of a pose.
 * @param {string} flag
 * @returns {Words}
 */
export function flagWords(flag) {
  return FLAGS[flag] ?? [flag.replaceAll("_", " "), ""];
}

/**
 * A count of this boot and the earlier ones, of the ledger of a status.
 * @param {any} ledger
 * @param {string} name
 * @returns {number}
 */
export function both(ledger, name) {
  return (ledger?.[name] ?? 0) + (ledger?.earlier_boots?.[name] ?? 0);
}
