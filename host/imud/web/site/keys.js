// SPDX-License-Identifier: MIT
// @ts-check
// Keys that work anywhere but in a field, and the dialog that lists them: those of the
// view, those of a log that is played, those of the page.

import { make } from "./dom.js";

/** @typedef {Record<string, [string, () => void]>} Map what a key does, and how */

/** Passes keys to the header or to the view. */
export class Keys {
  /**
   * @param {import("./header.js").Header} header
   * @param {() => Map} ofView
   */
  constructor(header, ofView) {
    this._ofView = ofView;
    this._playbar = header.playbar;
    /** @type {Map} */
    this._own = {
      1: ["Probe", () => header.go("probe")],
      2: ["Signals", () => header.go("signals")],
      3: ["Calibrate", () => header.go("calibrate")],
      4: ["Aim", () => header.go("aim")],
      5: ["Probes", () => header.go("probes")],
      6: ["Limb", () => header.go("limb")],
      "[": ["previous probe", () => header.step(-1)],
      "]": ["next probe", () => header.step(1)],
      t: ["light or dark", () => header.toggleTheme()],
      "?": ["these keys", () => this._show()],
    };
    this._dialog = make("dialog", { "aria-label": "Keys" });
    document.body.append(this._dialog);
    header.help.addEventListener("click", () => this._show());
    addEventListener("keydown", (event) => this._press(event));
  }

  _show() {
    const all = { ...this._ofView(), ...this._playbar.keys, ...this._own };
    const items = Object.entries(all).flatMap(([key, [words]]) => [
      make("dt", {}, make("kbd", {}, key === " " ? "space" : key)),
      make("dd", {}, words),
    ]);
    this._dialog.replaceChildren(
      make("h1", {}, "Keys"),
      make("dl", { class: "keys" }, ...items),
      make("p", { class: "muted" }, "In the picture: arrows turn it, + and − zoom, Home resets."),
      make(
        "form",
        { method: "dialog" },
        make("div", { class: "row" }, make("button", { class: "primary" }, "Close")),
      ),
    );
    this._dialog.showModal();
  }

  /** @param {KeyboardEvent} event */
  _press(event) {
    const target = /** @type {HTMLElement} */ (event.target);
    const isSlider = target.getAttribute("type") === "range";
    const isText = /^(INPUT|TEXTAREA|SELECT)$/.test(target.tagName) && !isSlider;
    const isItsOwn = isSlider && /^(Arrow|Home|End|Page)/.test(event.key);
    const isButton = event.key === " " && target.tagName === "BUTTON";
    const isElsewhere = document.querySelector("dialog[open]") !== null;
    if (isText || isItsOwn || isButton || isElsewhere || event.ctrlKey || event.metaKey || event.altKey) {
      return;
    }
    const key = event.key;
    const found = this._ofView()[key] ?? this._playbar.keys[key] ?? this._own[key];
    if (found) {
      event.preventDefault();
      found[1]();
    }
  }
}
