// SPDX-License-Identifier: MIT
// @ts-check
// The numbers beside the chart: how far, how sure, and the differences of the angles.

import { make, say } from "../dom.js";
import { angle, fixed, UNKNOWN } from "../format.js";
import { errorsOf } from "../model.js";
import { SIGMAS } from "./target.js";
import { voidWords } from "../views/words.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./target.js").Verdict} Verdict */
/** @typedef {import("../model.js").Pose} Pose */

const WORDS = {
  reached: "On target",
  unsure: "On target, but its error is too large",
  off: "Move the cross into the circle",
};

const WARNING = "Green is a calculation, never a permission. This is no medical device.";

const SINCE = { origin: ", since the origin", capture: ", since it was captured" };

/**
 * How sure an error is, and relative to what.
 * @param {Verdict} verdict
 * @param {boolean} isCaptured the target was captured
 */
function doubtWords({ sigma, since, lost }, isCaptured) {
  const how = since === null ? "" : SINCE[since];
  const doubt =
    sigma === null ? "error unknown" : `± ${fixed(SIGMAS * sigma, 2)}° (two sigma${how})`;
  if (lost === null) {
    return doubt;
  }
  const what = isCaptured ? "Capture the target" : "Set the origin";
  return `${doubt}. ${what} again: ${voidWords(lost)}`;
}

/**
 * What to do where no aim can be sure, however well it is held; empty: it can.
 * @param {Verdict} verdict
 * @param {Pose} pose
 * @param {Target} target
 */
function adviceOf({ sigma, since, lost }, pose, { tolerance_deg: tolerance, capture }) {
  if (sigma === null || lost !== null || SIGMAS * sigma < tolerance) {
    return "";
  }
  const { tilt_sigma_deg: tilt, heading_sigma_deg: turn } = errorsOf(pose);
  const what = capture ? "capture the target" : "set the origin";
  const again = since === null ? "" : " again";
  const known = since !== "origin" || turn === null ? "" : ` Its heading since then is known to ±${fixed(SIGMAS * turn, 1)}°.`;
  const byGravity =
    tilt !== null && SIGMAS * tilt < tolerance
      ? ` Or aim an axis at the vertical: gravity gives that to ±${fixed(SIGMAS * tilt, 1)}°.`
      : "";
  return `The error can't be below ±${fixed(SIGMAS * sigma, 1)}° now: ${what}${again}.${known}${byGravity}`;
}

/** Text that is read at a distance. */
export class Reading {
  constructor() {
    this._isCaptured = false;
    this._word = make("p", { class: "word", role: "status", "data-part": "word" });
    this._error = make("span", { class: "value", "data-value": "error" }, UNKNOWN);
    this._sigma = make("p", { class: "muted", "data-part": "sigma" });
    this._advice = make("p", { class: "notice small", "data-part": "advice", hidden: true });
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
      this._advice,
      this._goal,
      make("p", { class: "muted small", "data-part": "warning" }, WARNING),
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
    this._advice.hidden = true;
  }

  /**
   * @param {Verdict} verdict
   * @param {boolean} isDone
   * @param {string} age empty while the pose is fresh
   * @param {Pose} pose
   * @param {Target} target
   */
  show(verdict, isDone, age, pose, target) {
    const { error, state, differences } = verdict;
    say(this._error, fixed(error, 2, 6));
    say(this._sigma, doubtWords(verdict, this._isCaptured));
    const advice = age ? "" : adviceOf(verdict, pose, target);
    this._advice.hidden = advice === "";
    say(this._advice, advice);
    say(this._word, age ? `This is ${age} old` : isDone ? "Reached" : WORDS[state]);
    say(this._yaw, angle(differences.yaw));
    say(this._pitch, angle(differences.pitch));
    say(this._roll, angle(differences.roll));
  }
}
