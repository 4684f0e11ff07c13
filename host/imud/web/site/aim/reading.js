// SPDX-License-Identifier: MIT
// @ts-check
// The numbers beside the chart: how far, how sure, and the differences of the angles.

import { make, say } from "../dom.js";
import { angle, fixed, UNKNOWN } from "../format.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./target.js").Verdict} Verdict */

const WORDS = {
  reached: "On target",
  unsure: "On target, but not sure enough",
  off: "Move the cross into the circle",
};

/** Text that is read at a distance. */
export class Reading {
  constructor() {
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
  show({ error, sigma, state, differences }, isDone, age) {
    say(this._error, fixed(error, 2, 6));
    const doubt = sigma === null ? "" : `± ${fixed(2 * sigma, 2)}° (two sigma)`;
    say(this._sigma, doubt || "how sure is not known");
    say(this._word, age ? `This is ${age} old` : isDone ? "Reached" : WORDS[state]);
    say(this._yaw, angle(differences.yaw));
    say(this._pitch, angle(differences.pitch));
    say(this._roll, angle(differences.roll));
  }
}
