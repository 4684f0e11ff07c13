// SPDX-License-Identifier: MIT
// @ts-check
// New firmware for a probe: that there is some, a button, and how the writing does.

import { make, mark, say } from "../dom.js";
import { attempt } from "../header.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../model.js").Probe} Probe */
/** @typedef {{ board: string, filter: string, version: string, schema: string }} Firmware */

const ALL_FILTERS = "all";
// An F405 needs a pin wired first, so it is for the shell.
const BY_BUTTON = ["nano", "mega", "pico"];

/**
 * 0.2.0+1234567 as [0, 2, 0]; what is no version is older than all.
 * @param {string} version
 */
function release(version) {
  const found = /^(\d+)\.(\d+)\.(\d+)/.exec(version);
  return found ? found.slice(1).map(Number) : [-1, 0, 0];
}

/**
 * @param {string} one
 * @param {string} other
 */
function isNewer(one, other) {
  const [a, b] = [release(one), release(other)];
  const at = a.findIndex((number, i) => number !== b[i]);
  return at >= 0 && a[at] > b[at];
}

/**
 * The image for a probe that is newer than what it has.
 * @param {Record<string, any> | undefined} hello
 * @param {Firmware[]} firmware
 * @returns {Firmware | undefined}
 */
function newerFor(hello, firmware) {
  return firmware.find(
    ({ board, filter, version }) =>
      board === hello?.board &&
      [ALL_FILTERS, hello.filter].includes(filter) &&
      isNewer(version, hello.firmware ?? ""),
  );
}

/** Hidden as long as there is nothing to say. */
export class UpdateBox {
  /**
   * @param {Model} model
   * @param {string} name
   */
  constructor(model, name) {
    this._model = model;
    this._name = name;
    this._text = make("span", {});
    this._button = make("button", { onclick: () => this._begin() }, "Update firmware");
    this._share = make("progress", { max: "1", hidden: true, "aria-label": "written" });
    this._said = make("pre", { class: "small muted", hidden: true });
    this.element = make(
      "div",
      { class: "update", hidden: true, "data-part": "update" },
      make("div", { class: "row" }, this._text, this._button),
      this._share,
      this._said,
    );
  }

  /** @param {Probe} probe */
  draw(probe) {
    const { page, link } = this._model;
    const hello = probe.status?.hello;
    const found = newerFor(hello, page.firmware ?? []);
    const phase = probe.update?.phase;
    const isBusy = phase === "running" || phase === "done";
    this.element.hidden = found === undefined && !isBusy;
    const isByButton = BY_BUTTON.includes(hello?.board);
    const isOpen = link.state === "open";
    this._button.hidden = found === undefined || !isByButton || phase === "running";
    this._button.disabled = !isOpen;
    say(this._text, this._words(hello, found, probe.update));
    mark(this.element, "data-kind", phase === "refused" ? "bad" : false);
    const share = probe.update?.share ?? null;
    this._share.hidden = share === null;
    if (share !== null) {
      mark(this._share, "value", String(share));
    }
    this._said.hidden = probe.update === null;
    say(this._said, (probe.update?.said ?? []).join("\n"));
  }

  /**
   * @param {Record<string, any> | undefined} hello
   * @param {Firmware | undefined} found
   * @param {import("../link.js").Line | null} update
   */
  _words(hello, found, update) {
    if (update?.phase === "running") {
      return "New firmware is written: leave the probe plugged in.";
    }
    if (update?.phase === "refused") {
      return `The firmware was not updated: ${update.why}`;
    }
    if (found === undefined) {
      return "The firmware is updated.";
    }
    const how = BY_BUTTON.includes(hello?.board) ? "" : ` To update, run: imud flash ${this._name}`;
    return `Firmware ${found.version} is there; the probe has ${hello?.firmware}.${how}`;
  }

  async _begin() {
    this._button.disabled = true;
    await attempt(() => this._model.link.update(this._name));
  }
}
