// SPDX-License-Identifier: MIT
// @ts-check
// States, flags and concerns in words, each with the colour that it is shown in.

import { make } from "../dom.js";

/** @typedef {[words: string, kind: "good" | "warn" | "bad" | "", to?: string]} Words `to`: a link */

/** @type {Record<string, Words>} */
export const STATES = {
  streaming: ["streaming", "good"],
  idle: ["idle", ""],
  calibrating: ["starting: lay it still", "warn"],
  fault: ["fault", "bad"],
  silent: ["silent", "bad"],
  gone: ["unplugged", "bad"],
  "other schema": ["other firmware", "bad"],
  unheard: ["no data from the daemon", "bad"],
  unknown: ["unknown", ""],
};

/** @type {Record<string, Words>} */
const FLAGS = {
  starting: ["finding level and north", "warn"],
  uncalibrated: ["gyroscope bias unknown: lay it still for 3 s", "warn"],
  at_rest: ["at rest", ""],
  mag_disturbed: ["magnetic disturbance", "warn"],
  mag_absent: ["no magnetometer", "warn"],
  mag_off: ["magnetometer switched off", "warn"],
  clipped: ["sensor at its limit", "bad"],
  heading_free: ["heading drifts", "warn"],
  gap: ["gap", "bad"],
  tared: ["own origin", ""],
  calibration_old: ["calibrated over a year ago", "warn"],
  self_test_failed: ["self-test failed", "bad"],
  field_impossible: ["magnet or steel near", "bad"],
  field_unlike: ["field differs from its calibration", "warn"],
  force_impossible: ["accelerometer measures no gravity", "bad"],
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

/** @type {Record<string, string>} */
const VOIDS = {
  starting: "the attitude was lost",
  gap: "samples are missing",
  pause: "poses were missing",
  restarted: "it has restarted",
  params_changed: "its calibration has changed",
  origin_changed: "the origin has changed",
  unheard: "it was set before the daemon, or this page, received the probe",
};

/**
 * Why errors since a moment are not known any more.
 * @param {string} reason
 */
export function voidWords(reason) {
  return VOIDS[reason] ?? reason.replaceAll("_", " ");
}

/**
 * Shows words as chips, where they have changed.
 * @param {HTMLElement} element
 * @param {Words[]} all
 * @param {string} [kind] class of each chip
 */
export function showChips(element, all, kind = "") {
  const text = JSON.stringify(all);
  if (element.dataset.words !== text) {
    element.dataset.words = text;
    const chips = all.map(([words, colour, to]) => {
      const look = { class: `chip ${colour} ${kind}` };
      return to ? make("a", { ...look, href: to }, words) : make("span", look, words);
    });
    element.replaceChildren(...chips);
  }
}

/** @type {[RegExp, string][]} */
const PLACES = [
  [/imud calibrate verify/g, "Calibrate, check"],
  [/imud calibrate (acc|gyro|mag|mount|tip)( PROBE)?/g, "Calibrate, $1"],
  [/imud calibrate( PROBE)?/g, "Calibrate, all sensors"],
  [/run imud flash/g, "update it under Probes"],
  [/with imud (list|flash)/g, "under Probes"],
  [/see imud (list|ports)/g, "see Probes"],
];

/**
 * The daemon's words with the page's places for the command line's commands.
 * @param {string} words
 */
export function onPage(words) {
  return PLACES.reduce((text, [command, place]) => text.replace(command, place), words);
}

/**
 * Sentences about problems for the user to solve: the sensors first, then their
 * calibration, then why errors are withheld. @param {any} status @returns {Words[]} */
export function concerns(status) {
  const { words = [], flags = [], is_working = true } = status?.sensors ?? {};
  const isBad = !is_working || flags.length > 0;
  /** @type {Words[]} */
  const sentences = words.map((/** @type {string} */ each) => [each, isBad ? "bad" : "warn"]);
  const advice = status?.params?.advice;
  if (advice) {
    sentences.push([onPage(advice), "warn", `#/calibrate/${encodeURIComponent(status.probe)}`]);
  }
  for (const each of status?.quality?.withheld?.words ?? []) {
    sentences.push([each, "warn"]);
  }
  return sentences;
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
