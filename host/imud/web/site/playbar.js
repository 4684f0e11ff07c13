// SPDX-License-Identifier: MIT
// @ts-check
// The line below the header while a log is played: where it is, how fast, back to live.

import { make, mark, say } from "./dom.js";
import { span } from "./format.js";
import { timeOf, wordsOf } from "./marks.js";

/** @typedef {import("./model.js").Model} Model */

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 25, 50, 100];
const JUMP_MS = 5000; // of a key
const SEEK_MS = 100; // between two times that are asked for while the slider is drawn
const SETTLE_MS = 500; // after that the slider follows the log again

/** Hidden while what is shown is live. */
export class PlayBar {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._isPaused = false;
    /** @type {number | null} */
    this._wantedMs = null; // a time that is not yet asked for
    this._soughtMs = -Infinity; // when one was asked for last
    this._name = make("b", {});
    this._where = make("output", { "data-part": "played" });
    this._pause = make("button", { onclick: () => this._toggle() }, "Pause");
    this._slider = make("input", {
      type: "range",
      step: "any", // the keys then move it by a hundredth
      "aria-label": "Time of the log",
      oninput: () => {
        this._wantedMs = Number(this._slider.value);
      },
    });
    this._flags = make("div", { class: "marked" });
    this._flagged = "";
    const options = SPEEDS.map((speed) => make("option", { value: speed }, `${speed} times`));
    this._speed = make("select", { "aria-label": "Speed", onchange: () => this._tell() }, ...options);
    const live = make("button", { class: "primary", onclick: () => model.link.live() }, "Back to live");
    this.element = make(
      "div",
      { class: "playbar", hidden: true },
      make("span", {}, "Log ", this._name),
      make("div", { class: "flagged" }, this._slider, this._flags),
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

  /** Keys while a log is played. */
  get keys() {
    return /** @type {import("./keys.js").Map} */ (
      this.element.hidden
        ? {}
        : {
            k: ["log: pause or continue", () => this._toggle()],
            ",": ["log: 5 s back", () => this._jump(-JUMP_MS)],
            ".": ["log: 5 s forward", () => this._jump(JUMP_MS)],
          }
    );
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { played, link } = this._model;
    if (this.element.hidden) {
      return;
    }
    if (this._wantedMs !== null && nowMs - this._soughtMs >= SEEK_MS) {
      link.seek(this._wantedMs).catch(() => {});
      this._wantedMs = null;
      this._soughtMs = nowMs;
    }
    if (played && this._wantedMs === null && nowMs - this._soughtMs > SETTLE_MS) {
      mark(this._slider, "min", String(played.first_ms));
      mark(this._slider, "max", String(Math.max(played.last_ms, played.t_ms)));
      this._slider.value = String(played.t_ms);
    }
    this._flag();
    const time = played ? new Date(played.t_ms).toLocaleString() : "opening";
    const since = played ? `, ${span((played.t_ms - played.first_ms) / 1000)} in` : "";
    const left = played?.left_out ? `, ${played.left_out} unreadable messages left out` : "";
    const end = played?.error ? `stopped: ${played.error}` : `${time}, the end`;
    const where = (played?.over ? end : time + since) + left;
    say(this._where, where);
    mark(this._slider, "aria-valuetext", where);
    say(this._pause, this._isPaused ? "Continue" : "Pause");
  }

  /** A flag at each mark, which goes there. */
  _flag() {
    const { played, marks, selected, link } = this._model;
    const [firstMs, lastMs] = [played?.first_ms ?? 0, played?.last_ms ?? 0];
    const all = marks.of(selected).filter((one) => timeOf(one) >= firstMs && timeOf(one) <= lastMs);
    const flagged = `${firstMs} ${lastMs} ${all.map(({ id }) => id)}`;
    if (flagged !== this._flagged) {
      this._flagged = flagged;
      const flags = all.map((one) => {
        const label = `Mark ${wordsOf(one)}`;
        const flag = make("button", { "aria-label": label, title: label, onclick: () => link.seek(timeOf(one)) }, "⚑");
        flag.style.left = `${(100 * (timeOf(one) - firstMs)) / (lastMs - firstMs || 1)}%`;
        return flag;
      });
      this._flags.replaceChildren(...flags);
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

  /** @param {number} stepMs */
  _jump(stepMs) {
    const { played } = this._model;
    if (played) {
      const fromMs = this._wantedMs ?? played.t_ms;
      this._wantedMs = Math.min(played.last_ms, Math.max(played.first_ms, fromMs + stepMs));
    }
  }

  _tell() {
    const speed = this._isPaused ? 0 : Number(this._speed.value);
    this._model.link.play(this._model.page.playing, speed).catch(() => {});
  }
}
