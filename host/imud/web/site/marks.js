// SPDX-License-Identifier: MIT
// @ts-check
// Marks: values and notes from outside, each with where the tip was then.

/** @typedef {import("./link.js").Line} Line */
/** @typedef {import("./model.js").Model} Model */

/**
 * When it was made, UTC in ms.
 * @param {Line} mark
 */
export function timeOf({ id }) {
  return Number(id) / 1e6;
}

/**
 * When its pose was measured, UTC in ms: where it is among other poses.
 * @param {Line} mark
 */
export function momentOf({ id, t_pose_ns: poseNs }) {
  return Number(poseNs ?? id) / 1e6;
}

/** @param {Line} mark */
export function wordsOf({ value, unit, text }) {
  return [value, value === null ? "" : unit, text].filter((each) => each || each === 0).join(" ");
}

/** @type {readonly Line[]} */
const NONE = [];

/** The marks of each probe, as they are now: live, or in the log that is played. */
export class Marks {
  /** @param {Model} model */
  constructor(model) {
    /** @type {Map<string, readonly Line[]>} */
    this._all = new Map();
    this.momentMs = NaN; // that Signals are to show
    model.addEventListener("probe", (event) => {
      const line = /** @type {CustomEvent<Line>} */ (event).detail;
      if (line.type === "marks") {
        this._all.set(line.probe, line.marks);
      }
    });
    model.addEventListener("reset", () => this._all.clear());
  }

  /**
   * @param {string} probe
   * @returns {readonly Line[]} the oldest first
   */
  of(probe) {
    return this._all.get(probe) ?? NONE;
  }
}
