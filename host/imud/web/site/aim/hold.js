// SPDX-License-Identifier: MIT
// @ts-check
// How long a target has been held, and what was reached.

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./target.js").Verdict} Verdict */
/** @typedef {import("../model.js").Pose} Pose */

/**
 * @typedef {object} Reached
 * @property {string} target
 * @property {string} probe
 * @property {string} reached_utc
 * @property {number} held_s
 * @property {number} error_deg at the end
 * @property {number} sigma_deg at the end
 * @property {number} bound_deg the most that error plus two sigma was while it was held
 * @property {number} tolerance_deg
 * @property {string} axis
 * @property {readonly number[]} q
 * @property {readonly number[]} target_q
 */

/** Counts the time within tolerance; any pose outside restarts it. */
export class Hold {
  constructor() {
    /** @type {number | null} */
    this._since = null;
    this._bound = 0;
    this._last = 0;
    this.isDone = false;
  }

  /** Restarts, for another target or another try. */
  clear() {
    this._since = null;
    this._bound = 0;
    this.isDone = false;
  }

  /** Nothing is known for a while: what was held no longer counts. */
  interrupt() {
    this._since = null;
    this._bound = 0;
  }

  /**
   * Takes the verdict on a pose of that time; returns what was reached, once.
   * @param {Pose} pose
   * @param {Target} target
   * @param {Verdict} verdict
   * @returns {Reached | null}
   */
  take(pose, target, verdict) {
    const time = pose.t_device_us / 1e6;
    if (verdict.state !== "reached" || verdict.sigma === null || time < this._last) {
      this.interrupt();
      this._last = time;
      return null;
    }
    this._last = time;
    this._since ??= time;
    this._bound = Math.max(this._bound, verdict.error + 2 * verdict.sigma);
    if (this.isDone || time - this._since < target.hold_s) {
      return null;
    }
    this.isDone = true;
    const utcMs = pose.t_ns === null ? Date.now() : pose.t_ns / 1e6;
    return {
      target: target.name,
      probe: pose.probe,
      reached_utc: new Date(utcMs).toISOString(),
      held_s: time - this._since,
      error_deg: verdict.error,
      sigma_deg: verdict.sigma,
      bound_deg: this._bound,
      tolerance_deg: target.tolerance_deg,
      axis: target.axis,
      q: pose.q,
      target_q: target.q,
    };
  }

  /**
   * How much of the hold is done, 0 to 1.
   * @param {Target} target
   */
  share(target) {
    if (this.isDone) {
      return 1;
    }
    const held = this._since === null ? 0 : this._last - this._since;
    return target.hold_s > 0 ? Math.min(1, held / target.hold_s) : held > 0 ? 1 : 0;
  }
}

const COLUMNS = /** @type {const} */ ([
  "target",
  "probe",
  "reached_utc",
  "held_s",
  "error_deg",
  "sigma_deg",
  "bound_deg",
  "tolerance_deg",
  "axis",
  "q",
  "target_q",
]);

/**
 * A name that begins so would be a formula, which a spreadsheet runs.
 * @param {unknown} value
 */
const inert = (value) =>
  typeof value === "string" && /^[=+\-@\t\r]/.test(value) ? `'${value}` : String(value);

/**
 * The protocol as CSV, by RFC 4180; a quaternion is four numbers in one cell.
 * @param {readonly Reached[]} entries
 */
export function csvOf(entries) {

  const lines = entries.map((entry) =>
    COLUMNS.map((name) => {
      const value = entry[name];
      const text = Array.isArray(value) ? value.join(" ") : inert(value);
      return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
    }).join(","),
  );
  return `${[COLUMNS.join(","), ...lines].join("\r\n")}\r\n`;
}
