// SPDX-License-Identifier: MIT
// @ts-check
// The numbers beside the chart: how far, how sure, and the differences of the angles.

import { make, say } from "../dom.js";
import { angle, fixed, UNKNOWN } from "../format.js";
import { voidWords } from "../views/words.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./target.js").Verdict} Verdict */

const WORDS = {
  reached: "On target",
  unsure: "On target, but not sure enough",
  off: "Move the cross into the circle",
};

const SINCE = { origin: ", since the origin", capture: ", since it was captured" };

/**
 * How sure an error is, and relative to what.
 * @param {Verdict} verdict
 * @param {boolean} isCaptured the target was captured
 */
function doubtWords({ sigma, since, lost }, isCaptured) {
  const how = since === null ? "" : SINCE[since];
  const doubt =
    sigma === null ? "how sure is not known" : `± ${fixed(2 * sigma, 2)}° (two sigma${how})`;
  if (lost === null) {
    return doubt;
  }
  const what = isCaptured ? "Capture the target" : "Set the origin";
  return `${doubt}. ${what} anew: ${voidWords(lost)}`;
}

/** Text that is read at a distance. */
export class Reading {
  constructor() {
    this._isCaptured = false;
    this._word = make("p", { class: "word", role: "status", "data-part": "word" });
    this._error = make("span", { class: "value", "data-value": "error" }, UNKNOWN);
    this._sigma = make("p", { class: "muted", "data-part": "sigma" });
    this._goal = make("p", { class: "muted", "data-part": "goal" });
    const value = (/** @type {string} */ name) =>
      make("span", { class: "value", "data-value": name }, UNKNOWN);
    this._yaw = value("yaw");
    this._pitch = value("pitch");
    this._roll = value("roll");
    const row = (/** @type {string} */ name, /** @type {HTMLElement} */ number) =>
      make("div", {}, make("dt", {}, name), make("dd", {}, number, " °"));
    this.element = make(
      "div",
      { class: "reading" },
      this._word,
      make("p", { class: "axis-error" }, this._error, make("span", { class: "unit" }, "°")),
      this._sigma,
      this._goal,
      make(
        "dl",
        { class: "differences" },
        row("Yaw", this._yaw),
        row("Pitch", this._pitch),
        row("Roll", this._roll),
      ),
    );
  }

  /** @param {Target | null} target */
  goal(target) {
    this._isCaptured = Boolean(target?.capture);
    const what = target?.axis === "all" ? "attitude" : `${target?.axis} axis`;
    const within = `${what} within ${target?.tolerance_deg}°, for ${target?.hold_s} s`;
    say(this._goal, target === null ? "" : `${target.name}: ${within}`);
  }

  /** @param {string} why there is nothing to show */
  none(why) {
    say(this._word, why);
    for (const element of [this._error, this._yaw, this._pitch, this._roll]) {
      say(element, UNKNOWN);
    }
    say(this._sigma, "");
  }

  /**
   * @param {Verdict} verdict
   * @param {boolean} isDone
   * @param {string} age empty while the pose is fresh
   */
  show(verdict, isDone, age) {
    const { error, state, differences } = verdict;
    say(this._error, fixed(error, 2, 6));
    say(this._sigma, doubtWords(verdict, this._isCaptured));
    say(this._word, age ? `This is ${age} old` : isDone ? "Reached" : WORDS[state]);
    say(this._yaw, angle(differences.yaw));
    say(this._pitch, angle(differences.pitch));
    say(this._roll, angle(differences.roll));
  }
}
