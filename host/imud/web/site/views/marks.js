// SPDX-License-Identifier: MIT
// @ts-check
// The newest marks of the selected probe, and a form for another.

import { make, mark, scrolling } from "../dom.js";
import { fixed, UNKNOWN } from "../format.js";
import { tell } from "../header.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../model.js").Model} Model */

const HEADS = ["When", "Value", "Note", "Tip, mm"];

/** A card. */
export class MarksCard {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    /** @type {readonly Line[] | null} */
    this._shown = null;
    this._value = make("input", { name: "mark-value", inputmode: "decimal", "aria-label": "Value" });
    this._text = make("input", { name: "mark-text", maxlength: 200, "aria-label": "Note" });
    this._button = make("button", {}, "Mark");
    this._rows = make("tbody");
    this._table = scrolling("Marks", HEADS, this._rows);
    this._about = make(
      "p",
      { class: "muted small" },
      "A value measured at the tip, or a note: it is logged with the current pose.",
    );
    const submit = (/** @type {Event} */ event) => {
      event.preventDefault();
      this._send();
    };
    this.element = make(
      "div",
      { class: "card protocol marks", "data-part": "marks" },
      make("h2", {}, "Marks"),
      make(
        "form",
        { class: "row end", onsubmit: submit },
        make("label", { class: "field" }, "Value", this._value),
        make("label", { class: "field grow" }, "Note", this._text),
        this._button,
      ),
      this._table,
      this._about,
    );
  }

  draw() {
    const { selected, mayCommand, probe } = this._model;
    mark(this._button, "disabled", !mayCommand || probe === undefined);
    const marks = this._model.marks.of(selected);
    if (marks === this._shown) {
      return;
    }
    this._shown = marks;
    this._table.hidden = marks.length === 0;
    this._about.hidden = marks.length > 0;
    this._rows.replaceChildren(...[...marks].reverse().map(rowOf));
  }

  focus() {
    this._value.focus();
  }

  async _send() {
    const { link, selected } = this._model;
    const value = this._value.value.trim().replace(",", ".");
    const text = this._text.value.trim();
    try {
      await link.ask(selected, "mark", { ...(value && { value }), ...(text && { text }) });
      this._value.value = this._text.value = "";
    } catch (error) {
      tell(`Mark: ${error instanceof Error ? error.message : error}`, true);
    }
  }
}

/** @param {Line} line */
function rowOf({ t_ns: time, value, text, position_m: place, position_sigma_m: error }) {
  const at = place?.map((/** @type {number} */ each) => fixed(1000 * each, 1)).join(" ");
  const sure = error === null || error === undefined ? "" : ` ±${fixed(1000 * error, 1)}`;
  return make(
    "tr",
    {},
    make("td", {}, new Date(time / 1e6).toLocaleTimeString()),
    make("td", {}, value === null ? UNKNOWN : String(value)),
    make("td", {}, text),
    make("td", {}, at ? at + sure : UNKNOWN),
  );
}
