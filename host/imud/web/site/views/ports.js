// SPDX-License-Identifier: MIT
// @ts-check
// The serial ports of the daemon's machine: which it opens, and which are left to others.

import { make, say } from "../dom.js";
import { attempt } from "../header.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {{ port: string, kind: string, standing: string, is_opened: boolean, held_by: string[] }} Port */
/** @typedef {{ element: HTMLElement, about: HTMLElement, button: HTMLButtonElement }} Row */

const AGAIN_MS = 2000;

/** @type {Record<string, string>} */
const WORDS = {
  named: "opened: it is listed in [ports] or on the command line",
  ignored: "never opened: [ports] ignore lists it",
  "ours alone": "opened: a probe according to its USB name",
  adopted: "opened: a probe was detected there, or a user adopted it",
  off: "not opened: [ports] find is off",
  any: "opened, like all ports",
  unknown: "not opened: it may belong to another program. Adopt it if a probe is on it",
};

/** A card with the list; hidden where there are none. */
export class PortList {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._askedMs = -Infinity;
    /** @type {Map<string, Row>} */
    this._rows = new Map();
    this._list = make("ul", { class: "targets" });
    this.element = make(
      "div",
      { class: "card", hidden: true, "data-part": "ports" },
      make("h2", {}, "Serial ports"),
      this._list,
    );
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { page, link } = this._model;
    const isOn = Boolean(page.ports) && link.state === "open";
    if (!isOn) {
      this.element.hidden = true;
    } else if (nowMs - this._askedMs > AGAIN_MS) {
      this._askedMs = nowMs;
      link.ports().then(
        (ports) => this._show(ports.filter(({ standing }) => standing !== "built in")),
        () => {
          this.element.hidden = true;
        },
      );
    }
  }

  /** @param {Port[]} ports */
  _show(ports) {
    this.element.hidden = ports.length === 0;
    const names = ports.map(({ port }) => port);
    if (String(names) !== String([...this._rows.keys()])) {
      // The others stay as they are: a button may be under a mouse.
      this._rows = new Map(names.map((name) => [name, this._rows.get(name) ?? this._row(name)]));
      this._list.replaceChildren(...[...this._rows.values()].map(({ element }) => element));
    }
    for (const { port, kind, standing, held_by: holders } of ports) {
      const { about, button } = /** @type {Row} */ (this._rows.get(port));
      const held = holders.length ? `; open in ${holders.join(", ")}` : "";
      say(about, `${kind}: ${WORDS[standing] ?? standing}${held}`);
      button.hidden = standing !== "unknown" && standing !== "adopted";
      button.dataset.ours = String(standing === "unknown");
      say(button, standing === "unknown" ? "Adopt" : "Release");
    }
  }

  /**
   * @param {string} name
   * @returns {Row}
   */
  _row(name) {
    const about = make("span", {});
    const button = make("button", { "data-port": name, onclick: () => this._change(name, button) });
    const element = make(
      "li",
      {},
      make("span", {}, name, make("br"), about),
      make("div", { class: "row" }, button),
    );
    return { element, about, button };
  }

  /**
   * @param {string} name
   * @param {HTMLButtonElement} button
   */
  async _change(name, button) {
    button.disabled = true;
    await attempt(() => this._model.link.adopt(name, button.dataset.ours === "true"));
    button.disabled = false;
    this._askedMs = -Infinity;
  }
}
