// SPDX-License-Identifier: MIT
// @ts-check
// The list of targets, which this browser keeps; and targets from a file.

import { keep, kept } from "../dom.js";
import { fromAngles, normalized } from "../rotation.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("../rotation.js").Convention} Convention */

export const DEFAULTS = /** @type {const} */ ({ axis: "x", tolerance_deg: 2, hold_s: 2 });
const AXES = ["x", "y", "z", "all"];
const TARGETS_MAX = 500;

/** The targets in their order. */
export class Targets {
  constructor() {
    /** @type {Target[]} */
    this.all = readAll(kept("targets", []), "nautical", true);
  }

  /** @param {Target} target */
  add(target) {
    this.all = [...this.all.filter((one) => one.name !== target.name), target];
    keep("targets", this.all);
  }

  clear() {
    this.all = [];
    keep("targets", this.all);
  }

  /** @param {string} name */
  remove(name) {
    this.all = this.all.filter((one) => one.name !== name);
    keep("targets", this.all);
  }

  /**
   * The one after that, and the first after the last.
   * @param {string} name
   * @returns {Target | undefined}
   */
  after(name) {
    const place = this.all.findIndex((one) => one.name === name);
    return this.all[(place + 1) % Math.max(1, this.all.length)];
  }

  /** A name that is not in use. */
  freshName() {
    for (let number = this.all.length + 1; ; number++) {
      if (!this.all.some(({ name }) => name === `target ${number}`)) {
        return `target ${number}`;
      }
    }
  }

  /**
   * Adds the targets of a JSON or CSV file; an Error describes its mistake.
   * @param {string} text
   * @param {Convention} convention of angles in the file
   * */
  load(text, convention) {
    const isJson = /^\s*[[{]/.test(text);
    const found = readAll(isJson ? JSON.parse(text) : rowsOf(text), convention, false);
    if (found.length === 0) {
      throw new Error("it has no target, which needs name, and q or yaw, pitch, roll");
    }
    for (const target of found) {
      this.add(target);
    }
    return found.length;
  }
}

/**
 * Objects of a CSV file with a line of names.
 * @param {string} text
 */
function rowsOf(text) {
  const [head, ...lines] = text.trim().split(/\r?\n/);
  const names = head.split(",").map((name) => name.trim());
  return lines.map((line) => {
    const cells = line.split(",").map((cell) => cell.trim());
    return Object.fromEntries(names.map((name, index) => [name, cells[index] ?? ""]));
  });
}

/**
 * Those of some values that are targets.
 * @param {unknown} values
 * @param {Convention} convention
 * @param {boolean} isOurs this browser kept them, with how the daemon named captures
 * @returns {Target[]}
 */
function readAll(values, convention, isOurs) {
  const list = Array.isArray(values) ? values.slice(0, TARGETS_MAX) : [];
  return list.flatMap((value, index) => read(value, index, convention, isOurs) ?? []);
}

/**
 * @param {any} value
 * @param {number} index
 * @param {Convention} convention
 * @param {boolean} isOurs
 * @returns {Target | null}
 */
function read(value, index, convention, isOurs) {
  const q = Array.isArray(value?.q) && value.q.length === 4 ? value.q.map(Number) : null;
  const [yaw, pitch, roll] = ["yaw", "pitch", "roll"].map((name) => Number(value?.[name]));
  const angles = [yaw, pitch, roll].every(Number.isFinite) ? { yaw, pitch, roll } : null;
  if (!(q?.every(Number.isFinite) || angles)) {
    return null;
  }
  const turned = q ?? (angles ? fromAngles(angles, convention) : null);
  const number = (/** @type {"tolerance_deg" | "hold_s"} */ name, /** @type {number} */ least) => {
    const given = value[name] ?? "";
    if (given !== "" && !(Number(given) >= least) && !isOurs) {
      throw new Error(`target ${index + 1}: ${name} has to be ${least} or more`);
    }
    return given !== "" && Number(given) >= least ? Number(given) : DEFAULTS[name];
  };
  if (!q && Math.abs(pitch) > 90) {
    throw new Error(`target ${index + 1}: pitch has to be within 90 degrees`);
  }
  return {
    name: String(value.name || `target ${index + 1}`).slice(0, 60),
    q: normalized(/** @type {any} */ (turned)),
    axis: AXES.includes(value.axis) ? value.axis : DEFAULTS.axis,
    tolerance_deg: number("tolerance_deg", 0.01),
    hold_s: number("hold_s", 0),
    ...(isOurs && value.capture ? { capture: String(value.capture) } : {}),
  };
}
