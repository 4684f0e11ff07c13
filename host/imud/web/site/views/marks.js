// SPDX-License-Identifier: MIT
// @ts-check
// The marks of the selected probe: make one, correct it, take it back, go to its moment.

import { make, mark, say } from "../dom.js";
import { fixed } from "../format.js";
import { attempt } from "../header.js";
import { isAlone } from "../link.js";
import { momentOf, timeOf, wordsOf } from "../marks.js";
import { recorderOf } from "./signals.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../model.js").Model} Model */

const BEFORE_MS = 1000; // of a log, so that the motion to the mark is seen

/** A card. */
export class MarksCard {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._recorder = recorderOf(model);
    /** @type {readonly unknown[]} */
    this._shown = [];
    this._corrected = ""; // the id of a mark; empty: it will be another one
    const field = (/** @type {string} */ name, /** @type {string} */ label, limits = {}) =>
      make("input", { name: `mark-${name}`, "aria-label": label, ...limits });
    this._fields = {
      value: field("value", "Value", { inputmode: "decimal" }),
      unit: field("unit", "Unit", { maxlength: 20 }),
      text: field("text", "Note", { maxlength: 200 }),
    };
    this._button = make("button", {}, "Mark");
    this._cancel = make("button", { type: "button", hidden: true, onclick: () => this._edit(null) }, "Cancel");
    this._rows = make("ul", { class: "targets" });
    this._about = make(
      "p",
      { class: "muted small" },
      `A value measured at the tip, or a note: it is ${isAlone ? "kept until this page is closed," : "logged"} with the current pose.`,
    );
    const submit = (/** @type {Event} */ event) => {
      event.preventDefault();
      this._send();
    };
    this.element = make(
      "div",
      { class: "card marks", "data-part": "marks" },
      make("h2", {}, "Marks"),
      make(
        "form",
        { class: "row end", onsubmit: submit },
        make("label", { class: "field" }, "Value", this._fields.value),
        make("label", { class: "field" }, "Unit", this._fields.unit),
        make("label", { class: "field grow" }, "Note", this._fields.text),
        this._button,
        this._cancel,
      ),
      this._rows,
      this._about,
    );
  }

  draw() {
    const { selected, mayCommand, probe, marks } = this._model;
    mark(this._button, "disabled", !mayCommand || probe === undefined);
    const shown = [marks.of(selected), mayCommand];
    if (shown.every((each, index) => each === this._shown[index])) {
      return;
    }
    this._shown = shown;
    const rows = [...marks.of(selected)].reverse().map((one) => this._row(one, mayCommand));
    this._about.hidden = rows.length > 0;
    this._rows.replaceChildren(...rows);
  }

  focus() {
    this._fields.value.focus();
  }

  /** @param {Line | null} one that is corrected from here on; null: none is */
  _edit(one) {
    const { value, unit, text } = this._fields;
    this._corrected = one?.id ?? "";
    value.value = String(one?.value ?? "");
    unit.value = one?.unit ?? unit.value; // the next one has the same
    text.value = one?.text ?? "";
    say(this._button, one ? "Correct" : "Mark");
    this._cancel.hidden = one === null;
    this.focus();
  }

  async _send() {
    const given = Object.entries(this._fields).map(([name, { value }]) => [name, value.trim()]);
    const values = Object.fromEntries(given.filter(([, value]) => value || this._corrected));
    if (values.value) {
      values.value = values.value.replace(",", ".");
    }
    if (await this._ask({ ...values, ...(this._corrected && { id: this._corrected }) })) {
      this._edit(null);
    }
  }

  /** @param {Record<string, string>} parameters */
  async _ask(parameters) {
    const { link, selected } = this._model;
    return attempt(() => link.ask(selected, "mark", parameters), "Mark");
  }

  /**
   * Shows its moment: in the log that is played, in Signals while they have it, else in
   * the log of then.
   * @param {Line} one
   */
  async _go(one) {
    const { link, page, marks } = this._model;
    const { pose } = this._recorder;
    const timeMs = timeOf(one);
    await attempt(async () => {
      if (!page.playing && pose.length > 0 && pose.time(0) * 1000 <= momentOf(one)) {
        marks.momentMs = momentOf(one);
        location.hash = "#/signals";
        return;
      }
      if (!page.playing) {
        const logs = page.logs ? await link.logs() : [];
        const log = logs.reverse().find(({ changed_ms: endMs }) => endMs >= timeMs);
        if (log === undefined) {
          throw new Error("its moment is in no log that this page may read");
        }
        await link.play(log.name, 1);
      }
      await link.seek(timeMs - BEFORE_MS);
    }, "Mark");
  }

  /**
   * @param {Line} one
   * @param {boolean} mayCommand
   */
  _row(one, mayCommand) {
    const { id, position_m: place, position_sigma_m: error, no_position: why } = one;
    const at = place?.map((/** @type {number} */ each) => fixed(1000 * each, 1)).join(" ");
    const sure = error === null || error === undefined ? "" : ` ±${fixed(1000 * error, 1)}`;
    const when = new Date(timeOf(one)).toLocaleTimeString();
    const small = (/** @type {string} */ text, /** @type {string} */ label, /** @type {() => void} */ onclick) =>
      make("button", { class: "small", "aria-label": `${label} ${when}`, onclick }, text);
    const actions = [
      small("Correct", "Correct the mark of", () => this._edit(one)),
      small("×", "Take back the mark of", () => this._ask({ id, withdraw: "1" })),
    ];
    const about = make("span", { class: "muted" }, `${when}, ${at ? `tip at ${at}${sure} mm` : (why ?? "no position")}`);
    return make(
      "li",
      {},
      make("span", {}, make("b", {}, wordsOf(one)), make("br"), about),
      make("div", { class: "row" }, small("Show", "Show the moment of", () => this._go(one)), ...(mayCommand ? actions : [])),
    );
  }
}
