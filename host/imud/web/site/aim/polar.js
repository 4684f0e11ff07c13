// SPDX-License-Identifier: MIT
// @ts-check
// The polar chart of section 7.3 of the NECTEC paper: the circle is the target, the cross
// is the probe. Angles are drawn on a logarithmic scale, so that 180 degrees fit and half
// a degree can be seen.

import { draw, mark } from "../dom.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./target.js").Verdict} Verdict */

const RADIUS = 150;
const RINGS = [5, 10, 30, 90];
const CROSS = 15;

/** @param {number} degrees */
function scale(degrees) {
  return (RADIUS * Math.log1p(degrees)) / Math.log1p(180);
}

/** An SVG picture. */
export class Polar {
  constructor() {
    this._circle = draw("circle", { r: 20, class: "goal" });
    this._hold = draw("circle", { r: 20, class: "hold", pathLength: 1, transform: "rotate(-90)" });
    this._doubt = draw("circle", { r: 5, class: "doubt" });
    this._mark = draw(
      "g",
      { class: "cross" },
      this._doubt,
      draw("path", { d: `M${-CROSS} 0H${CROSS}M0 ${-CROSS}V${CROSS}` }),
      draw("path", { class: "top", d: `M-4 ${-CROSS + 5}L0 ${-CROSS - 3}L4 ${-CROSS + 5}` }),
    );
    const rings = RINGS.flatMap((degrees) => [
      draw("circle", { r: scale(degrees), class: "ring" }),
      draw("text", { x: 0, y: -scale(degrees) - 4, class: "tick" }, `${degrees}°`),
    ]);
    this.element = draw(
      "svg",
      { viewBox: "-172 -172 344 344", class: "polar", role: "img" },
      draw("circle", { r: RADIUS, class: "rim" }),
      draw("path", { d: `M${-RADIUS} 0H${RADIUS}M0 ${-RADIUS}V${RADIUS}`, class: "ring" }),
      ...rings,
      this._circle,
      this._hold,
      this._mark,
    );
  }

  /** Shows the empty chart. */
  clear() {
    mark(this.element, "data-empty", true);
    mark(this.element, "aria-label", "no target");
  }

  /**
   * @param {Target} target
   * @param {Verdict} verdict
   * @param {number} held 0 to 1
   */
  show(target, verdict, held) {
    const { error, sigma, offset, twist, state } = verdict;
    const [x, y] = offset;
    const length = Math.hypot(x, y);
    const factor = length > 0 ? scale(length) / length : 0;
    const goal = scale(target.tolerance_deg).toFixed(1);
    mark(this._circle, "r", goal);
    mark(this._hold, "r", goal);
    mark(this._hold, "stroke-dasharray", `${held.toFixed(3)} 1`);
    const doubt = sigma === null ? RADIUS : scale(error + 2 * sigma) - scale(error);
    mark(this._doubt, "r", doubt.toFixed(1));
    const turn = target.axis === "all" ? twist : 0;
    const place = `${(x * factor).toFixed(1)} ${(-y * factor).toFixed(1)}`;
    mark(this._mark, "transform", `translate(${place}) rotate(${turn.toFixed(1)})`);
    mark(this.element, "data-empty", false);
    mark(this.element, "data-state", state);
    mark(this.element, "aria-label", `${error.toFixed(1)} degrees from the target`);
  }
}
