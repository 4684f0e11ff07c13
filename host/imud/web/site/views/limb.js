// SPDX-License-Identifier: MIT
// @ts-check
// A limb that several probes sit on, as `imud body` publishes it: the figure in 3D and in
// the sagittal plane, angles and foot over time, and the instructions of the alignment.

import { make, mark, pictured, say } from "../dom.js";
import { span } from "../format.js";
import { AlignCard, AnglesCard, GaitCard } from "../limb/cards.js";
import { Figure } from "../limb/figure.js";
import { LimbRecorder } from "../limb/recorder.js";
import { SetupCard } from "../limb/setup.js";
import { Sagittal } from "../limb/sagittal.js";
import { Chart } from "../signals/chart.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../link.js").Line} Line */

const STALE_MS = 400;
const DRAW_MS = 40;
const NUMBERS_MS = 50;
const SHOWN_S = 10;
const HERE = "Strap a probe to each segment of a leg or an arm, and choose which sits where.";
const ELSEWHERE = "An operator sets one up on the page of the daemon's own machine, or with imud body.";

/** A view of one limb. */
export class LimbView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    /** @type {readonly string[]} */
    this.every = [];
    this.keys = {};
    this._drawnMs = 0;
    this._numbersMs = 0;
    this._choice = make("select", { "aria-label": "Limb", onchange: () => this._choose() });
    this._age = make("span", { class: "chip warn", "data-part": "age", hidden: true });
    this._setup = new SetupCard(model);
    this._hint = make("p", { class: "muted" });
    this._empty = make("div", { class: "no-limb stack" }, this._hint);
    this._align = new AlignCard(model);
    this._angles = new AnglesCard();
    this._gait = new GaitCard();
    this._sagittal = new Sagittal();
    this._charts = make("div", { class: "charts" });
    /** @type {Chart[]} */
    this._plots = [];
    this._stage = make("div", { class: "stage" });
    this._recorder = new LimbRecorder("");
    /** @type {LimbRecorder["history"]} */
    this._history = null;
    this._side = make("aside", { class: "side" }, this._align.element, this._angles.element, this._gait.element);
    this._body = make(
      "div",
      { class: "limb-body", hidden: true },
      make(
        "div",
        { class: "limb-main" },
        make(
          "div",
          { class: "picture card" },
          this._stage,
          make("div", { class: "over top-left" }, this._choice, this._age),
        ),
        this._sagittal.element,
        this._charts,
      ),
      this._side,
    );
    this.element = make("section", { class: "limb view" }, this._empty, this._body);
    /** @type {Figure | null} */
    this.figure = null;
    this._hear = (/** @type {Event} */ event) => {
      this._take(/** @type {CustomEvent<Line>} */ (event).detail);
    };
    model.addEventListener("body", this._hear);
    this._reset = () => this._choose();
    model.addEventListener("reset", this._reset);
  }

  /** Every state of the limb that is shown. */
  get more() {
    const name = this._recorder.name;
    return /** @type {[string, string][]} */ (name ? [[name, "body"]] : []);
  }

  close() {
    this._model.removeEventListener("body", this._hear);
    this._model.removeEventListener("reset", this._reset);
    this._setup.close();
    this.figure?.close();
    this._closeCharts();
  }

  recolour() {
    this.figure?.recolour();
    for (const chart of this._plots) {
      chart.recolour();
    }
  }

  /** @param {number} hz frames a second */
  adapt(hz) {
    this.figure?.adapt(hz);
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const names = [...this._model.bodies.keys()].sort();
    this._empty.hidden = names.length > 0;
    this._body.hidden = names.length === 0;
    const place = names.length > 0 ? this._side : this._empty;
    if (this._setup.element.parentElement !== place) {
      place.append(this._setup.element);
    }
    this._setup.draw();
    say(this._hint, `No limb yet. ${this._setup.element.hidden ? ELSEWHERE : HERE}`);
    this._list(names);
    const body = this._model.bodies.get(this._recorder.name);
    if (body === undefined) {
      return;
    }
    const { state, heardMs } = body;
    const isStale = nowMs - heardMs > STALE_MS || this._model.link.state !== "open";
    mark(this.element, "data-stale", isStale);
    mark(this._body, "data-aligned", Boolean(state.aligned));
    this._scene()?.show(state, isStale);
    this.figure?.draw();
    if (nowMs - this._numbersMs >= NUMBERS_MS) {
      this._numbersMs = nowMs;
      this._align.show(state);
      this._angles.show(state, isStale);
      this._gait.show(this._recorder.events);
      this._age.hidden = !isStale;
      say(this._age, `${span((nowMs - heardMs) / 1000)} old`);
    }
    if (nowMs - this._drawnMs >= DRAW_MS) {
      this._drawnMs = nowMs;
      this._sagittal.draw(isStale);
      this._drawCharts();
    }
  }

  /** @param {Line} state */
  _take(state) {
    if (this._recorder.name === "") {
      this._recorder = new LimbRecorder(state.body);
    }
    if (state.body === this._recorder.name) {
      this._recorder.take(state);
      this._sagittal.add(state);
    }
  }

  /** @param {string[]} names */
  _list(names) {
    const text = names.join("\n");
    if (this._choice.dataset.names !== text) {
      this._choice.dataset.names = text;
      this._choice.replaceChildren(...names.map((name) => make("option", { value: name }, name)));
    }
    if (this._recorder.name === "" && names.length > 0) {
      this._recorder = new LimbRecorder(names[0]);
    }
    if (this._choice.value !== this._recorder.name) {
      this._choice.value = this._recorder.name;
    }
  }

  _choose() {
    this._recorder = new LimbRecorder(this._choice.value);
    this._sagittal.clear();
  }

  _drawCharts() {
    const { history, plots } = this._recorder;
    if (history !== this._history) {
      this._history = history;
      this._closeCharts();
      if (history !== null) {
        this._plots = plots.map((plot) => {
          const decimals = () => (plot.unit === "°" ? 1 : 3); // a joint is known to a degree
          return new Chart(plot, history, { onZoom: () => {}, onLive: () => {}, decimals });
        });
      }
      this._charts.replaceChildren(...this._plots.map(({ element }) => element));
    }
    const to = history?.last ?? NaN;
    for (const chart of Number.isNaN(to) ? [] : this._plots) {
      chart.draw({ from: to - SHOWN_S, to });
    }
  }

  _closeCharts() {
    for (const chart of this._plots) {
      chart.close();
    }
    this._plots = [];
  }

  /** The 3D picture, made when there is a limb. */
  _scene() {
    if (this.figure === null && !this._stage.hasChildNodes()) {
      this.figure = pictured(this._stage, () => new Figure(this._stage));
    }
    return this.figure;
  }
}
