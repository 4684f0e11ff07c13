// SPDX-License-Identifier: MIT
// @ts-check
// A way there and back to a mark, step by step with a count-down: the origin is set on the
// mark, and the daemon closes the path after the second stroke.

import { run, setOrigin } from "../commands.js";
import { make, mark, say } from "../dom.js";
import { tell } from "../header.js";
import { chime } from "../sound.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../model.js").Model} Model */

const STROKE_MS = 2000; // a longer one has a larger error
const STILL_MS = 1000;
// What to do, and how long; a step without a time waits for the stroke to begin.
const STEPS = [
  { words: "Put the tip on the mark and hold it still", ms: 3000 },
  { words: "Press, and move to the other point", ms: 0 },
  { words: "Stop there and release", ms: STROKE_MS },
  { words: "Hold it still", ms: STILL_MS },
  { words: "Press, and move back to the mark", ms: 0 },
  { words: "Stop on the mark and release", ms: STROKE_MS },
  { words: "Hold it still", ms: STILL_MS },
];
const THERE = 2; // the steps of the strokes
const BACK = 5;

export class ThereAndBack {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._probe = "";
    this._step = STEPS.length; // over
    this._sinceMs = 0;
    this._text = make("span", { role: "status" });
    this._bar = make("progress", { max: 1, "aria-label": "Until the next step" });
    const cancel = make("button", { class: "small", onclick: () => this._go(STEPS.length) }, "Cancel");
    this.element = make("div", { class: "held", hidden: true }, this._text, this._bar, cancel);
    this.button = make("button", { onclick: () => this._begin() }, "There and back");
    model.addEventListener("probe", (event) => this._hear(/** @type {CustomEvent<Line>} */ (event).detail));
  }

  _begin() {
    this._probe = this._model.selected;
    this._go(0);
  }

  /** @param {number} step */
  _go(step) {
    this._step = step;
    this._sinceMs = performance.now();
    if (step < STEPS.length) {
      chime([step === THERE || step === BACK ? 660 : 880]);
    }
  }

  /** @param {Line} line */
  _hear(line) {
    const isStroke = line.type === "stroke" && line.probe === this._probe;
    const to = this._step <= THERE ? THERE : BACK;
    if (!isStroke || this._step < THERE - 1 || this._step > BACK) {
      return;
    }
    if (line.end !== "running" && !line.displacement_m) {
      this._go(STEPS.length);
      tell(`There and back: ${line.advice ?? line.end.replace("_", " ")}; begin again`, true);
    } else if (line.end !== "running") {
      this._go(to + 1);
    } else if (this._step < to) {
      this._go(to);
    }
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const step = STEPS[this._step];
    if (step && this._model.selected !== this._probe) {
      this._go(STEPS.length);
    }
    this.element.hidden = !STEPS[this._step];
    if (this.element.hidden) {
      return;
    }
    const leftMs = Math.max(0, step.ms - (nowMs - this._sinceMs));
    say(this._text, `${step.words}${step.ms ? `: ${Math.ceil(leftMs / 1000)} s` : ""}`);
    this._bar.hidden = step.ms === 0;
    mark(this._bar, "value", String(1 - leftMs / (step.ms || 1)));
    if (leftMs === 0 && step.ms && this._step !== THERE && this._step !== BACK) {
      this._next();
    }
  }

  _next() {
    this._go(this._step + 1);
    if (this._step === 1) {
      void setOrigin(this._model, "all").then((isSet) => {
        if (!isSet) {
          this._go(STEPS.length); // it has said why
        }
      });
    } else if (this._step > BACK) {
      void run(this._model, "Close path", [["close", {}]]);
    }
  }
}
