// SPDX-License-Identifier: MIT
// @ts-check
// What the errors of poses are made of, and what makes each part smaller.

import { make } from "../dom.js";
import { fixed } from "../format.js";

/** @typedef {import("../model.js").Probe} Probe */
/** @typedef {[name: string, now: string, cure: string]} Part `cure`: what lowers it */

const TILT_OF_ACC = (Math.SQRT2 / 9.80665) * (180 / Math.PI); // of two axes, m/s2 to degrees

/**
 * @param {Probe} probe
 * @returns {Part[]}
 */
export function partsOf({ pose, status }) {
  const params = status?.params ?? {};
  const flags = pose?.flags ?? [];
  const { sigma_m_s2: acc } = params.acc ?? {};
  const { sigma_uT: mag } = params.mag ?? {};
  const known = [
    ...(acc > 0 ? [`tilt ±${fixed(acc * TILT_OF_ACC, 2)}°`] : []),
    ...(mag > 0 ? [`field ±${fixed(mag, 1)} µT`] : []),
  ];
  const isMeasured = !flags.includes("uncalibrated");
  // Where the heading has no error the daemon says why, and what to do.
  const { tilt, heading } = status?.quality?.withheld ?? {};
  const [field, away] = ((heading !== tilt && heading) || "").split(/[:;] /, 2);
  const isDisturbed = flags.includes("mag_disturbed");
  const stay = isDisturbed ? "move away from iron" : "stay an arm's length away from iron";
  const condition = params.acc?.condition ?? "unknown";
  const warmth = condition === "calibrated" ? "near that of the calibration" : condition;
  const bias = `bias ${isMeasured ? "" : "not "}measured since power-on`;
  return [
    ["calibration", known.join(", ") || "none", known.length ? "calibrate again, with care" : "calibrate all sensors"],
    ["gyroscope", bias, isMeasured ? "let it lie for 3 s now and then" : "lay it still for 3 s"],
    ["field here", field || (isDisturbed ? "disturbed" : "undisturbed"), away ?? stay],
    ["temperature", warmth, "let it warm up for some minutes, or calibrate as warm as it is used"],
  ];
}

/** A folded list of the parts. */
export class Accuracy {
  constructor() {
    this._list = make("dl", { class: "result" });
    this._shown = "";
    this.element = make(
      "details",
      { "data-part": "accuracy" },
      make("summary", {}, "What the errors are made of, and what lowers them"),
      this._list,
    );
  }

  /** @param {Probe} probe */
  show(probe) {
    const parts = partsOf(probe);
    const text = JSON.stringify(parts);
    if (text !== this._shown) {
      this._shown = text;
      const rows = parts.map(([name, now, cure]) => {
        const words = make("dd", {}, now, make("br"), make("span", { class: "muted small" }, cure));
        return make("div", {}, make("dt", {}, name), words);
      });
      this._list.replaceChildren(...rows);
    }
  }
}
