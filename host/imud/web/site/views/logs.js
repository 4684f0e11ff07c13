// SPDX-License-Identifier: MIT
// @ts-check
// The logs of the daemon, to download.

import { make, say, save } from "../dom.js";
import { fixed } from "../format.js";
import { attempt } from "../header.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {{ element: HTMLElement, about: HTMLElement }} Row */

const AGAIN_MS = 5000;

/** A card with the list; hidden where there are none. */
export class LogList {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._askedMs = -Infinity;
    /** @type {Map<string, Row>} by name, as they are listed */
    this._rows = new Map();
    this._list = make("ul", { class: "targets" });
    this.element = make("div", { class: "card", hidden: true }, make("h2", {}, "Logs"), this._list);
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { page, link } = this._model;
    const isOn = Boolean(page.logs) && link.state === "open";
    if (isOn && nowMs - this._askedMs > AGAIN_MS) {
      this._askedMs = nowMs;
      link.logs().then(
        (files) => this._show(files),
        () => {
          this.element.hidden = true;
        },
      );
    }
  }

  /** @param {{ name: string, bytes: number, changed_ms: number }[]} files */
  _show(files) {
    this.element.hidden = files.length === 0;
    const names = files.map(({ name }) => name);
    if (String(names) !== String([...this._rows.keys()])) {
      // The others stay as they are: a button may be under a mouse, or loading.
      this._rows = new Map(names.map((name) => [name, this._rows.get(name) ?? this._row(name)]));
      this._list.replaceChildren(...[...this._rows.values()].map(({ element }) => element));
    }
    for (const { name, bytes, changed_ms: changed } of files) {
      const about = /** @type {Row} */ (this._rows.get(name)).about;
      say(about, `${fixed(bytes / 1e6, 1)} MB, ${new Date(changed).toLocaleString()}`);
    }
  }

  /**
   * @param {string} name
   * @returns {Row}
   */
  _row(name) {
    const about = make("span", {});
    const log = make("button", { "data-log": name, onclick: () => this._loadLog(name, log) }, "MCAP");
    const tables = make(
      "button",
      { "data-tables": name, onclick: () => this._loadTables(name, tables) },
      "CSV",
    );
    const play = make("button", { "data-play": name, onclick: () => this._play(name) }, "Play");
    const element = make(
      "li",
      {},
      make("span", {}, name, make("br"), about),
      make("div", { class: "row" }, play, tables, log),
    );
    return { element, about };
  }

  /** @param {string} name */
  async _play(name) {
    const { link, page, played } = this._model;
    await attempt(async () => {
      await link.play(name, 1);
      if (page.playing === name && played) {
        await link.seek(played.first_ms);
      }
      location.hash = "#/probe";
    }, name);
  }

  /**
   * Of a log that is being written, fetches what it has at the start, because it may
   * grow faster than its parts come.
   * @param {string} name
   * @param {HTMLButtonElement} button
   */
  async _loadLog(name, button) {
    await this._load(name, button, async () => {
      const files = await this._model.link.logs();
      return { name, bytes: files.find((file) => file.name === name)?.bytes ?? 0 };
    });
  }

  /**
   * @param {string} log
   * @param {HTMLButtonElement} button
   */
  async _loadTables(log, button) {
    await this._load(log, button, async () => {
      say(button, "Making tables\u2026");
      return this._model.link.tables(log);
    });
  }

  /**
   * Fetches a file part by part.
   * @param {string} about the log
   * @param {HTMLButtonElement} button
   * @param {() => Promise<{ name: string, bytes: number }>} find
   */
  async _load(about, button, find) {
    const { link } = this._model;
    /** @type {Uint8Array<ArrayBuffer>[]} */
    const parts = [];
    const label = button.textContent ?? "";
    let offset = 0;
    button.disabled = true;
    await attempt(async () => {
      const { name, bytes: end } = await find();
      do {
        const part = await link.read(name, offset);
        if (part.length === 0) {
          break;
        }
        parts.push(part);
        offset += part.length;
        say(button, `${fixed(Math.min(offset, end) / 1e6, 1)} of ${fixed(end / 1e6, 1)} MB`);
      } while (offset < end);
      save(name, new Blob(parts));
    }, about);
    button.disabled = false;
    say(button, label);
  }
}
