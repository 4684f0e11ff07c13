// SPDX-License-Identifier: MIT
// @ts-check
// Live plots of the selected probe, with ten minutes to scroll back.

import { keep, kept, make, mark, save } from "../dom.js";
import { decimalsOf } from "../format.js";
import { attempt } from "../header.js";
import { errorsOf } from "../model.js";
import { Bar, SPANS } from "../signals/bar.js";
import { Chart } from "../signals/chart.js";
import { csvOf, pngOf } from "../signals/files.js";
import { KEPT_S } from "../signals/history.js";
import { FIRST, PLOTS } from "../signals/plots.js";
import { Recorder } from "../signals/recorder.js";
import { convention } from "./convention.js";

/** @typedef {import("../model.js").Model} Model */

// Plots are drawn this often: more is not seen, and costs a slow machine its frames.
const DRAW_MS = 40;
const LEAST_SPAN = 0.2;

/** Recorders outlive the view, so that a look at another view loses nothing. */
/** @type {WeakMap<Model, { recorder: Recorder, probe: string }>} */
const recorders = new WeakMap();

/**
 * The recorder of the selected probe, which begins to record at the first call.
 * @param {Model} model
 */
export function recorderOf(model) {
  let made = recorders.get(model);
  if (made === undefined) {
    const recorder = new Recorder(model.link);
    const fresh = { recorder, probe: model.selected };
    made = fresh;
    recorders.set(model, made);
    model.addEventListener("reset", () => recorder.clear());
    model.addEventListener("probe", (event) => {
      const line = /** @type {CustomEvent} */ (event).detail;
      if (model.selected !== fresh.probe) {
        fresh.probe = model.selected;
        recorder.clear();
      }
      if (line.probe === model.selected) {
        recorder.take(line);
      }
    });
  }
  return made.recorder;
}

/** A view of the selected probe. */
export class SignalsView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this.every = ["pose", "raw"];
    this._recorder = recorderOf(model);
    this._recorder.setConvention(convention());
    this._span = kept("span", 10);
    this._isLive = true;
    this._end = 0;
    this._drawnMs = 0;
    /** @type {Map<string, Chart>} */
    this._charts = new Map();
    this._list = make("div", { class: "charts" });
    this._bar = new Bar(this._span, {
      play: () => this._setLive(!this._isLive),
      span: (seconds) => this._setSpan(seconds),
      slide: (share) => this._slide(share),
      csv: () => this._saveCsv(),
      png: () => this._savePng(),
    });
    const send = () => this._sendRaw();
    const restart = () => this._recorder.restartGyro();
    this._noRaw = make(
      "div",
      { class: "notice row", hidden: true },
      "This probe sends no raw samples, which some of these plots need.",
      make("button", { onclick: send }, "Send raw samples"),
    );
    this._restart = make(
      "button",
      { class: "small", hidden: true, onclick: restart },
      "Restart the gyroscope's angles",
    );
    this.element = make(
      "section",
      { class: "signals view" },
      this._bar.element,
      make("div", { class: "row between" }, this._makeChoice(), this._restart),
      this._noRaw,
      this._list,
    );
    this._list.addEventListener("wheel", (event) => this._wheel(event), { passive: false });
    for (const id of kept("plots", FIRST)) {
      this._show(id);
    }
    this.keys = /** @type {import("../keys.js").Map} */ ({
      " ": ["pause or continue", () => this._setLive(!this._isLive)],
      ArrowLeft: ["scroll back", () => this._scroll(-0.25)],
      ArrowRight: ["scroll forward", () => this._scroll(0.25)],
      "+": ["zoom in", () => this._zoom(0.5)],
      "-": ["zoom out", () => this._zoom(2)],
      c: ["save CSV", () => this._saveCsv()],
      p: ["save PNG", () => this._savePng()],
    });
  }

  close() {
    for (const chart of this._charts.values()) {
      chart.close();
    }
  }

  recolour() {
    for (const chart of this._charts.values()) {
      chart.recolour();
    }
  }

  /** The seconds that are shown. */
  get window() {
    return { from: this._end - this._span, to: this._end };
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    if (nowMs - this._drawnMs < DRAW_MS) {
      return;
    }
    this._drawnMs = nowMs;
    const { last } = this._recorder;
    const { marks, selected } = this._model;
    if (!Number.isNaN(marks.momentMs)) {
      this._isLive = false;
      this._end = marks.momentMs / 1000 + this._span / 2;
      marks.momentMs = NaN;
    }
    if (this._isLive && last > 0) {
      this._end = last;
    }
    for (const chart of this._charts.values()) {
      chart.draw(this.window, marks.of(selected));
    }
    this._bar.show(this._isLive, last - this._end);
    this._notices();
  }

  _makeChoice() {
    const shown = new Set(kept("plots", FIRST));
    const buttons = PLOTS.map(({ id, title }) => {
      const button = make(
        "button",
        {
          class: "chip toggle",
          "aria-pressed": String(shown.has(id)),
          "data-choose": id,
          onclick: () => {
            const isOn = !this._charts.has(id);
            mark(button, "aria-pressed", String(isOn));
            if (isOn) {
              this._show(id);
            } else {
              this._hide(id);
            }
            keep("plots", [...this._charts.keys()]);
          },
        },
        title.split(/[:,]/)[0],
      );
      return button;
    });
    return make("div", { class: "row choose", role: "group", "aria-label": "Plots" }, ...buttons);
  }

  /** @param {string} id */
  _show(id) {
    const plot = PLOTS.find((one) => one.id === id);
    if (plot === undefined || this._charts.has(id)) {
      return;
    }
    const history = this._recorder[plot.source];
    const chart = new Chart(plot, history, {
      onZoom: ({ from, to }) => {
        this._end = to;
        this._setSpan(to - from);
        this._setLive(false);
      },
      onLive: () => this._setLive(true),
      decimals: id === "attitude" ? (index) => this._decimals(index) : undefined,
    });
    this._charts.set(id, chart);
    // In the order of the list, whenever they were chosen.
    const order = PLOTS.map((one) => this._charts.get(one.id)?.element);
    this._list.append(...order.filter((element) => element !== undefined));
  }

  /**
   * An angle of the attitude has as many as its error allows.
   * @param {number} index of the series
   */
  _decimals(index) {
    const pose = this._model.probe?.pose;
    const errors = pose ? errorsOf(pose) : null;
    const isTurn = index === (convention() === "nectec" ? 2 : 0);
    return decimalsOf(isTurn ? errors?.heading_sigma_deg : errors?.tilt_sigma_deg);
  }

  /** @param {string} id */
  _hide(id) {
    const chart = this._charts.get(id);
    chart?.close();
    chart?.element.remove();
    this._charts.delete(id);
  }

  _notices() {
    const needsRaw = [...this._charts.values()].some(({ plot }) => plot.source === "raw");
    const { raw, pose } = this._recorder;
    const isMissing = !(raw.length && raw.last > (pose.last || 0) - 2);
    this._noRaw.hidden = !(needsRaw && isMissing && pose.length > 0);
    const hasGyro = this._charts.has("pitch") || this._charts.has("roll");
    this._restart.hidden = !hasGyro || isMissing;
  }

  /** @param {boolean} isLive */
  _setLive(isLive) {
    this._isLive = isLive;
    this._drawnMs = 0;
  }

  /** @param {number} seconds */
  _setSpan(seconds) {
    this._span = Math.min(KEPT_S, Math.max(LEAST_SPAN, seconds));
    this._drawnMs = 0;
    if (SPANS.includes(seconds)) {
      keep("span", seconds);
    }
    this._bar.setSpan(this._span);
  }

  /** @param {number} factor */
  _zoom(factor) {
    this._setSpan(this._span * factor);
  }

  /** @param {number} share of the window */
  _scroll(share) {
    const { last } = this._recorder;
    const oldest = Math.max(last - KEPT_S, 0) + this._span;
    this._end = Math.min(last, Math.max(oldest, this._end + share * this._span));
    this._setLive(share > 0 && this._end === last);
  }

  /** @param {number} share of what is kept: 0 the oldest, 1 the newest */
  _slide(share) {
    const { pose, raw, last } = this._recorder;
    const first = Math.min(...[pose, raw].map((one) => (one.length ? one.time(0) : Infinity)));
    if (Number.isFinite(first)) {
      this._end = Math.min(last, first + this._span) * (1 - share) + last * share;
      this._setLive(share === 1);
    }
  }

  /** @param {WheelEvent} event */
  _wheel(event) {
    if (event.ctrlKey || event.shiftKey) {
      event.preventDefault();
      this._zoom(Math.exp((event.deltaY || event.deltaX) * 0.002));
    }
  }

  async _sendRaw() {
    const { selected, link, probe } = this._model;
    const hz = String(probe?.status?.hello?.pose_rate ?? 100);
    await attempt(async () => {
      await link.ask(selected, "rate", { stream: "raw", hz });
      await link.ask(selected, "fields", { streams: "pose,raw" });
    });
  }

  _fileName() {
    const stamp = new Date(this._end * 1000).toISOString().replace(/[:.]/g, "-");
    return `${this._model.selected}-${stamp.slice(0, 19)}`;
  }

  /** The shown columns of each history, as CSV. */
  get csv() {
    const sources = /** @type {const} */ (["pose", "raw"]);
    const parts = sources.map((source) => ({
      history: this._recorder[source],
      columns: [...this._charts.values()]
        .filter(({ plot }) => plot.source === source)
        .flatMap(({ plot }) => plot.series.map(([, column]) => column)),
    }));
    return csvOf(parts.filter(({ columns }) => columns.length > 0), this.window);
  }

  _saveCsv() {
    save(`${this._fileName()}.csv`, new Blob([this.csv], { type: "text/csv" }));
  }

  async _savePng() {
    const charts = [...this._charts.values()];
    save(`${this._fileName()}.png`, await pngOf(charts, this._fileName()));
  }
}
