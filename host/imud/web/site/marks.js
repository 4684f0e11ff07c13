// SPDX-License-Identifier: MIT
// @ts-check
// Marks: values and notes from outside, each with where the tip was then.

/** @typedef {import("./link.js").Line} Line */
/** @typedef {import("./model.js").Model} Model */

const KEPT_MAX = 100;

/** The marks that came since the page was opened, by probe. */
export class Marks {
  /** @param {Model} model */
  constructor(model) {
    /** @type {Map<string, Line[]>} */
    this._all = new Map();
    model.addEventListener("probe", (event) => {
      const line = /** @type {CustomEvent<Line>} */ (event).detail;
      if (line.type === "mark") {
        this._all.set(line.probe, [...this.of(line.probe), line].slice(-KEPT_MAX));
      }
    });
    model.addEventListener("reset", () => this._all.clear());
  }

  /**
   * @param {string} probe
   * @returns {readonly Line[]}
   */
  of(probe) {
    return this._all.get(probe) ?? [];
  }
}
