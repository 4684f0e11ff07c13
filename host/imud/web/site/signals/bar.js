// SPDX-License-Identifier: MIT
// @ts-check
// The buttons above the plots: pause, how much is shown, scroll back, save.

import { make, mark, say } from "../dom.js";
import { span } from "../format.js";
import { KEPT_S } from "./history.js";

/** Seconds that can be chosen. */
export const SPANS = [5, 10, 30, 60, 120, 300, KEPT_S];
const STEPS = 1000; // of the slider

/** A row that stays at the top. */
export class Bar {
  /**
   * @param {number} seconds
   * @param {{ play: () => void, span: (seconds: number) => void,
   *   slide: (share: number) => void, csv: () => void, png: () => void }} events
   */
  constructor(seconds, events) {
    this._play = make("button", { onclick: events.play }, "Pause");
    const options = SPANS.map((one) => make("option", { value: one }, span(one)));
    this._span = make(
      "select",
      { "aria-label": "Seconds shown", onchange: () => events.span(Number(this._span.value)) },
      ...options,
    );
    this.setSpan(seconds);
    this._slider = make("input", {
      type: "range",
      min: 0,
      max: STEPS,
      "aria-label": "Scroll back",
      oninput: () => events.slide(Number(this._slider.value) / STEPS),
    });
    this._where = make("output", { class: "muted", "data-part": "where" });
    this.element = make(
      "div",
      { class: "bar" },
      this._play,
      this._span,
      this._slider,
      this._where,
      make("button", { onclick: events.csv }, "CSV"),
      make("button", { onclick: events.png }, "PNG"),
    );
  }

  /** @param {number} seconds */
  setSpan(seconds) {
    this._span.value = SPANS.includes(seconds) ? String(seconds) : "";
  }

  /**
   * @param {boolean} isLive
   * @param {number} back seconds from the end of the window to the last value
   */
  show(isLive, back) {
    say(this._play, isLive ? "Pause" : "Live");
    mark(this._play, "class", isLive ? "" : "primary");
    say(this._where, isLive ? "live" : `${span(Math.max(0, back))} back`);
    if (isLive) {
      this._slider.value = String(STEPS);
    }
  }
}
