// SPDX-License-Identifier: MIT
// @ts-check
// The reached targets, with time and error; this browser keeps them until they are
// cleared.

import { keep, kept, make, save, scrolling } from "../dom.js";
import { fixed } from "../format.js";
import { csvOf } from "./hold.js";

/** @typedef {import("./hold.js").Reached} Reached */

const REACHED_MAX = 1000;
const SHOWN = 50;
const HEADS = ["Target", "When", "Error °", "± 2σ °"];

/** A card with a table. */
export class Protocol {
  constructor() {
    /** @type {Reached[]} */
    this._all = kept("reached", []);
    this._rows = make("tbody");
    const saver = (/** @type {string} */ name, /** @type {string} */ type) => () => {
      const isCsv = type === "text/csv";
      const text = isCsv ? csvOf(this._all) : JSON.stringify(this._all, null, 2);
      save(name, new Blob([text], { type }));
    };
    this.element = make(
      "div",
      { class: "card protocol" },
      make("h2", {}, "Reached"),
      scrolling("Reached", HEADS, this._rows),
      make(
        "div",
        { class: "row" },
        make("button", { onclick: saver("reached.csv", "text/csv") }, "CSV"),
        make("button", { onclick: saver("reached.json", "application/json") }, "JSON"),
        make("button", { class: "danger", onclick: () => this._set([]) }, "Clear"),
      ),
    );
    this._show();
  }

  /** @param {Reached} reached */
  add(reached) {
    this._set([...this._all, reached].slice(-REACHED_MAX));
  }

  /** @param {Reached[]} all */
  _set(all) {
    this._all = all;
    keep("reached", all);
    this._show();
  }

  _show() {
    const rows = this._all
      .slice(-SHOWN)
      .reverse()
      .map(({ target, reached_utc: utc, error_deg: error, sigma_deg: sigma }) => {
        const when = new Date(utc).toLocaleTimeString();
        const cells = [target, when, fixed(error, 2), fixed(2 * sigma, 2)];
        return make("tr", {}, ...cells.map((text) => make("td", {}, text)));
      });
    const none = make("tr", {}, make("td", { colspan: HEADS.length, class: "muted" }, "nothing yet"));
    this._rows.replaceChildren(...(rows.length ? rows : [none]));
  }
}
