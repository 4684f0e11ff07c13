// SPDX-License-Identifier: MIT
// @ts-check
// Gestures of a probe's button: what each is to do, a count-down while it is held, and a
// sound for what it did; an origin that it moved can be undone here.

import { make, mark, say } from "./dom.js";
import { allowSound, chime } from "./sound.js";
import { run } from "./commands.js";

/** @typedef {import("./link.js").Line} Line */
/** @typedef {import("./model.js").Model} Model */

const GESTURES = ["Click", "Double click", "Hold 1 s", "Hold 3 s"];
const HOLDS_MS = [0, 0, 1000, 3000, 10_000]; // with the last a hand lies upon it
const UNDO_MS = 20_000;
/** @type {Record<string, string>} */
const ACTIONS = {
  none: "nothing",
  stream: "start or stop",
  stroke: "stroke while held",
  path: "close path",
  origin: "set origin",
  undo: "undo origin",
  mark: "mark",
};
/** @type {Record<string, number[]>} Hz */
const NOTES = { tare: [523, 659, 784], refused: [330, 220], held: [880] };

/** The choice for the selected probe. */
export class ButtonForm {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._shown = "";
    this._about = make("p", { class: "muted small" });
    this._choices = GESTURES.map((name, index) => {
      const actions = Object.entries(ACTIONS).filter(([action]) => action !== "stroke" || index === 2);
      return make("select", { "aria-label": name }, ...actions.map(([value, text]) => make("option", { value }, text)));
    });
    const fields = GESTURES.map((name, index) => make("label", { class: "field" }, name, this._choices[index]));
    const send = (/** @type {string} */ button) => {
      allowSound();
      return run(model, "Button", [["configure", { button }]]);
    };
    const back = make("button", { type: "button", onclick: () => send("") }, "Leave it to the probe");
    const onsubmit = (/** @type {Event} */ event) => {
      event.preventDefault();
      send(this._choices.map(({ value }) => value).join(","));
    };
    const row = make("div", { class: "row" }, make("button", {}, "Apply"), back);
    const form = make("form", { class: "stack inner", onsubmit }, this._about, ...fields, row);
    this.element = make("details", { class: "with-daemon" }, make("summary", {}, "Button"), form);
  }

  draw() {
    const { name, status } = this._model.probe ?? {};
    const isTold = status?.params?.options?.button_does === "tell";
    const shown = JSON.stringify([name, status?.button, isTold]);
    if (status?.button && shown !== this._shown) {
      this._shown = shown;
      this._choices.forEach((choice, index) => {
        choice.value = status.button[index];
      });
      const alone = "The probe acts on its button by itself. Apply lets imud act on it.";
      say(this._about, isTold ? "imud acts on its button. Strokes: where imud computes the poses." : alone);
    }
  }
}

/** The line above every view: what the button of the selected probe does now. */
export class ButtonLine {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._pressedMs = this._movedMs = -Infinity;
    this._step = 1; // of the gestures, which holding it has reached
    this._text = make("span", { role: "status" });
    this._bar = make("progress", { max: 1, "aria-label": "Until the next gesture" });
    const undo = () => {
      this._movedMs = -Infinity;
      run(model, "Undo origin", [["tare", { what: "undo" }]]);
    };
    this._undo = make("button", { class: "small", onclick: undo }, "Undo");
    this.element = make("div", { class: "held", hidden: true }, this._text, this._bar, this._undo);
    model.addEventListener("probe", (event) => this._hear(/** @type {CustomEvent<Line>} */ (event).detail));
    addEventListener("pointerdown", allowSound, { once: true });
  }

  /** @param {Line} line */
  _hear(line) {
    const { selected, probe, page } = this._model;
    if (line.probe !== selected || page.playing) {
      return;
    }
    if (line.type === "event" && line.event.startsWith("button_")) {
      const isPress = line.event === "button_pressed" && probe?.status?.params?.options?.button_does === "tell";
      this._pressedMs = isPress ? performance.now() : -Infinity;
      this._step = 1;
    } else if (line.type === "command") {
      const isByButton = line.by === "button";
      const isMoved = isByButton && !line.refused && line.parameters.what === "all";
      this._movedMs = isMoved ? performance.now() : line.command === "tare" ? -Infinity : this._movedMs;
      if (isByButton) {
        chime(NOTES[line.refused ? "refused" : line.command]);
      }
    }
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const heldMs = nowMs - this._pressedMs;
    const isHeld = heldMs < HOLDS_MS[4] && !this._model.page.playing;
    const isMoved = !isHeld && nowMs - this._movedMs < UNDO_MS;
    this.element.hidden = !isHeld && !isMoved;
    this._bar.hidden = !isHeld;
    this._undo.hidden = !isMoved || !this._model.mayCommand;
    if (isMoved) {
      say(this._text, "Its button has set the origin. Undo: back to east, north and up.");
    } else if (isHeld) {
      const step = Math.max(1, HOLDS_MS.findLastIndex((ms) => ms <= heldMs));
      if (step > this._step) {
        chime(NOTES.held);
      }
      this._step = step;
      const table = this._model.probe?.status?.button ?? [];
      const now = step > 1 ? `Release: ${ACTIONS[table[step]]}. ` : "";
      const left = Math.ceil((HOLDS_MS[step + 1] - heldMs) / 1000);
      say(this._text, `${now}In ${left} s: ${ACTIONS[table[step + 1] ?? "none"]}.`);
      mark(this._bar, "value", String(heldMs / HOLDS_MS[step + 1]));
    }
  }
}
