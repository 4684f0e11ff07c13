// SPDX-License-Identifier: MIT
// @ts-check
// The line below the header while a log is played: where it is, how fast, back to live.

import { make, say } from "./dom.js";

/** @typedef {import("./model.js").Model} Model */

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 25, 50, 100];

/** Hidden while what is shown is live. */
export class PlayBar {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._isPaused = false;
    this._name = make("b", {});
    this._where = make("output", { "data-part": "played" });
    this._pause = make("button", { onclick: () => this._toggle() }, "Pause");
    const options = SPEEDS.map((speed) => make("option", { value: speed }, `${speed} times`));
    this._speed = make("select", { "aria-label": "Speed", onchange: () => this._tell() }, ...options);
    const live = make("button", { class: "primary", onclick: () => model.link.live() }, "Back to live");
    this.element = make(
      "div",
      { class: "playbar", hidden: true },
      make("span", {}, "Log ", this._name),
      this._where,
      this._pause,
      this._speed,
      live,
    );
    model.addEventListener("reset", () => {
      this._isPaused = false;
      this._speed.value = "1";
    });
    model.addEventListener("list", () => this._show());
  }

  draw() {
    const { played } = this._model;
    if (!this.element.hidden) {
      const time = played ? new Date(played.t_ms).toLocaleString() : "opening";
      say(this._where, played?.over ? `${time}, the end` : time);
      say(this._pause, this._isPaused ? "Go on" : "Pause");
    }
  }

  _show() {
    const name = this._model.page.playing ?? "";
    this.element.hidden = name === "";
    say(this._name, name);
  }

  _toggle() {
    this._isPaused = !this._isPaused;
    this._tell();
  }

  _tell() {
    const speed = this._isPaused ? 0 : Number(this._speed.value);
    this._model.link.play(this._model.page.playing, speed).catch(() => {});
  }
}
