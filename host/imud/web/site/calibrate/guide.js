// SPDX-License-Identifier: MIT
// @ts-check
// The current instruction, the progress, and the expected errors.

import { make, mark, say } from "../dom.js";
import { fixed } from "../format.js";
import { onPage } from "../views/words.js";
import { MountPicture } from "./mount.js";

/** @typedef {import("../link.js").Line} Line */

/** @type {Record<string, string>} */
export const KINDS = {
  all: "all sensors, 12 poses",
  acc: "accelerometer alone",
  gyro: "gyroscope alone",
  mag: "magnetometer alone, by waving",
  mount: "mounting of the module, five poses",
  tip: "position of the tip, by wobbling",
  verify: "check, in ten seconds",
};

/** @type {Record<string, string>} */
const FIRST = {
  none: "Choose what to calibrate. You need a table, at least half an arm's length away from iron.",
  refused: "Refused. The previous calibration stays active.",
  done: "Done.",
};

/** A card. */
export class GuideCard {
  /** @param {{ begin: () => void, end: () => void, stop: () => void }} events */
  constructor({ begin, end, stop }) {
    const options = Object.entries(KINDS).map(([value, text]) => make("option", { value }, text));
    this.kind = make("select", { "aria-label": "What to calibrate" }, ...options);
    this.begin = make("button", { class: "primary", onclick: begin }, "Begin");
    this._end = make("button", { onclick: end }, "Finish now");
    this._stop = make("button", { onclick: stop }, "Cancel");
    const all = () => {
      this.kind.value = "all";
      begin();
    };
    this._first = make("button", { class: "primary", onclick: all }, "Calibrate all sensors");
    this._says = make("p", { class: "says", role: "status", "data-part": "says" });
    this._trouble = make("p", { class: "notice", role: "alert", hidden: true });
    this._mount = new MountPicture();
    this._share = make("progress", { max: 1, value: 0 });
    this._state = make("span", { class: "chip" });
    this._poses = make("b", {});
    this._tilt = make("dd", { class: "value", "data-value": "cal-tilt" });
    this._heading = make("dd", { class: "value", "data-value": "cal-heading" });
    this._facts = make(
      "dl",
      { class: "facts" },
      make("div", {}, make("dt", {}, "tilt, error to expect"), this._tilt),
      make("div", {}, make("dt", {}, "heading, error to expect"), this._heading),
    );
    this._tip = make("p", { class: "value", "data-value": "cal-tip", hidden: true });
    this._bar = make("progress", { max: 100, value: 0, "aria-label": "Quality of the field" });
    this._quality = make("span", { class: "value" });
    this._steps = make(
      "div",
      { class: "stack" },
      make("div", { class: "row" }, this._state, this._share, this._poses),
      this._facts,
      this._tip,
      make("div", { class: "row quality" }, make("span", { class: "muted" }, "field"), this._bar, this._quality),
    );
    this.element = make(
      "div",
      { class: "card guide" },
      make("div", { class: "row" }, this.kind, this.begin, this._end, this._stop),
      this._says,
      this._trouble,
      this._first,
      this._mount.element,
      this._steps,
    );
  }

  /**
   * @param {Line | null} line
   * @param {boolean} mayBegin
   */
  show(line, mayBegin) {
    const phase = line?.phase ?? "none";
    const isRunning = phase === "running" || phase === "preparing";
    this.kind.hidden = this.begin.hidden = isRunning;
    mark(this.begin, "disabled", !mayBegin);
    this._first.hidden = phase !== "refused" || !line?.needs || !mayBegin;
    mark(this.begin, "class", line?.needs || line?.outcome ? "" : "primary");
    this._end.hidden = phase !== "running" || line?.kind === "verify";
    this._stop.hidden = !isRunning;
    say(this._says, isRunning ? line?.says : (FIRST[phase] ?? ""));
    const trouble = isRunning ? line?.trouble : line?.why;
    this._trouble.hidden = !trouble;
    say(this._trouble, onPage(trouble ?? ""));
    this._steps.hidden = phase !== "running";
    this._mount.show(line?.outcome?.mount ?? line?.mount);
    if (phase === "running" && line !== null) {
      this._running(line);
    }
  }

  /** @param {Line} line */
  _running(line) {
    const hasPoses = line.poses !== undefined;
    const isTip = line.kind === "tip";
    this._state.hidden = this._share.hidden = !hasPoses && !isTip;
    say(this._state, line.is_still ? "still" : "moves");
    mark(this._state, "class", line.is_still ? "chip good" : "chip");
    mark(this._share, "aria-label", isTip ? "Time of wobbling" : "Time that it lies still");
    const still = line.is_still ? (line.still_share ?? 0) : 0;
    this._share.value = isTip ? Math.min(1, line.seconds / line.of_seconds) : still;
    say(this._poses, hasPoses ? `pose ${line.poses} of ${line.of}` : `${fixed(line.seconds, 0)} s`);
    error(this._tilt, line.tilt_deg, line.is_level);
    error(this._heading, line.heading_deg, line.is_headed);
    this._facts.hidden = isTip || line.kind === "mount";
    this._tip.hidden = !isTip;
    if (isTip) {
      say(this._tip, wobble(line));
      mark(this._tip, "data-good", line.is_good);
    }
    const percent = line.quality_percent;
    this._bar.value = percent ?? 0;
    say(this._quality, percent === null ? "" : `${fixed(percent, 0, 3)} %`);
  }
}

/**
 * How the probe is wobbled about its tip, and how well the tip is known.
 * @param {Line} line
 */
function wobble(line) {
  if (line.score_m === null) {
    return "tip: not yet";
  }
  const how = `${fixed(line.swing_deg, 0)}° to each side, ${fixed(line.hz, 1)} a second`;
  return `tip ±${fixed(1000 * line.score_m, 1)} mm; ${how}`;
}

/**
 * @param {HTMLElement} element
 * @param {number | null | undefined} degrees
 * @param {boolean} isGood
 */
function error(element, degrees, isGood) {
  const isKnown = degrees !== null && degrees !== undefined;
  say(element, isKnown ? `±${fixed(degrees, 2)}°` : "not yet");
  mark(element, "data-good", isKnown && isGood);
}
