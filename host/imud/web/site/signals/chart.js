// SPDX-License-Identifier: MIT
// @ts-check
// One plot with its own legend, which shows the values at the cursor, else the last ones.

import uPlot from "../vendor/uplot/uPlot.esm.min.js";
import { make, say } from "../dom.js";
import { fixed } from "../format.js";
import { momentOf, wordsOf } from "../marks.js";
import { reduce } from "./reduce.js";

/** @typedef {import("./plots.js").Plot} Plot */
/** @typedef {import("./history.js").History} History */
/** @typedef {{ from: number, to: number }} Window seconds */

const LEAST_RANGE = 0.2; // of the y axis: noise of a probe at rest does not fill it
const FONT = "12px system-ui, sans-serif";
const FLAG_ROWS = 3; // of flags that are near each other
const TIME_SPACE = 84; // pixels between two times below the plot

/** @param {string} name */
function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/**
 * A time of day, with tenths where it is between seconds.
 * @param {number} seconds
 */
function clock(seconds) {
  const time = new Date(Math.round(seconds * 1000));
  const tenths = time.getMilliseconds() ? `.${Math.round(time.getMilliseconds() / 100)}` : "";
  return time.toTimeString().slice(0, 8) + tenths;
}

/**
 * The line of a series, broken where a value is missing.
 * @param {uPlot} plot
 * @param {number} series
 * @param {number} first
 * @param {number} last
 */
function paths(plot, series, first, last) {
  const stroke = new Path2D();
  const [times, values] = [plot.data[0], plot.data[series]];
  let isDrawn = false;
  for (let i = first; i <= last; i++) {
    const value = values[i];
    if (value === null || value === undefined) {
      isDrawn = false;
      continue;
    }
    const [x, y] = [plot.valToPos(times[i], "x", true), plot.valToPos(value, "y", true)];
    if (isDrawn) {
      stroke.lineTo(x, y);
    } else {
      stroke.moveTo(x, y);
    }
    isDrawn = true;
  }
  return { stroke };
}

/** As many as the errors and the noise leave. @type {Record<string, number>} */
const DECIMALS = { ms: 0, "µT": 1, "°C": 1, sine: 3 };

/** A card with a plot. */
export class Chart {
  /**
   * @param {Plot} plot
   * @param {History} history
   * @param {{ onZoom: (window: Window) => void, onLive: () => void, decimals?: (index: number) => number }} events
   *   `decimals`: of the value of a series
   */
  constructor(plot, history, { onZoom, onLive, decimals = () => DECIMALS[plot.unit] ?? 2 }) {
    this.plot = plot;
    this._decimals = decimals;
    this._history = history;
    this._columns = plot.series.map(([, column]) => history.names.indexOf(column));
    this._values = plot.series.map(() => make("b", {}, "–"));
    const legend = plot.series.map(([name, , colour], index) => {
      const swatch = make("i", { class: "swatch", "data-colour": colour });
      const button = make(
        "button",
        { class: "series", "aria-pressed": "true", onclick: () => this._toggle(index, button) },
        swatch,
        `${name} `,
        this._values[index],
      );
      return button;
    });
    this._canvas = make("div", { class: "plot" });
    this.element = make(
      "div",
      { class: "card chart", "data-plot": plot.id },
      make(
        "div",
        { class: "card-head" },
        make("h2", {}, `${plot.title}, ${plot.unit}`),
        make("div", { class: "row" }, ...legend),
      ),
      this._canvas,
    );
    this._onZoom = onZoom;
    /** @type {readonly import("../link.js").Line[]} */
    this._marks = [];
    /** @type {uPlot | null} */
    this._plot = null;
    this._canvas.addEventListener("dblclick", onLive);
    this._resizer = new ResizeObserver(() => this._resize());
    this._resizer.observe(this._canvas);
  }

  /**
   * Draws the rows of a window.
   * @param {Window} window
   * @param {readonly import("../link.js").Line[]} [marks]
   */
  draw({ from, to }, marks = []) {
    this._marks = marks;
    const plot = this._plot;
    if (plot === null) {
      return;
    }
    const wrap = this.plot.isAngle ? 270 : Infinity;
    const bins = Math.max(50, Math.round(plot.width));
    const data = reduce(this._history, this._columns, from, to, bins, wrap);
    plot.batch(() => {
      plot.setData(/** @type {any} */ (data), false);
      plot.setScale("x", { min: from, max: to });
    });
    this._legend(plot, data);
  }

  recolour() {
    this._plot?.destroy();
    this._plot = null;
    this._resize();
  }

  close() {
    this._resizer.disconnect();
    this._plot?.destroy();
  }

  /** The plot as it is on the screen. */
  get picture() {
    return this._plot?.ctx.canvas ?? null;
  }

  /**
   * @param {uPlot} plot
   * @param {(number | null)[][]} data
   */
  _legend(plot, data) {
    const last = data[0].length - 1;
    const at = plot.cursor.idx ?? last;
    this._values.forEach((element, index) => {
      const value = data[index + 1]?.[Math.min(at, last)];
      say(element, fixed(value, this._decimals(index), 8));
    });
  }

  /**
   * @param {number} index
   * @param {HTMLElement} button
   */
  _toggle(index, button) {
    const isShown = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", String(isShown));
    this._plot?.setSeries(index + 1, { show: isShown });
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this._canvas;
    if (width < 10) {
      return;
    }
    if (this._plot === null) {
      this._plot = new uPlot(this._options(width, height), [[]], this._canvas);
    } else if (this._plot.width !== width || this._plot.height !== height) {
      this._plot.setSize({ width, height });
    }
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  _options(width, height) {
    const axis = {
      stroke: css("muted"),
      font: FONT,
      grid: { stroke: css("line"), width: 1 },
      ticks: { stroke: css("line"), width: 1, size: 4 },
    };
    /** @type {uPlot.Options} */
    const options = {
      width,
      height,
      legend: { show: false },
      cursor: {
        sync: { key: "imud" },
        drag: { x: true, y: false, setScale: false },
        bind: { dblclick: () => null },
        points: { size: 6 },
      },
      scales: {
        x: { time: true, range: (_, min, max) => [min, max] },
        y: { range: (_, min, max) => this._range(min, max) },
      },
      axes: [
        { ...axis, size: 30, space: TIME_SPACE, values: (_, times) => times.map(clock) },
        { ...axis, size: 52 },
      ],
      series: [{}, ...this.plot.series.map((one) => this._series(one))],
      hooks: { setSelect: [(plot) => this._select(plot)], draw: [(plot) => this._flag(plot)] },
    };
    return options;
  }

  /** @param {[string, string, string]} series */
  _series([label, , colour]) {
    return { label, stroke: css(colour), width: 1.5, points: { show: false }, paths };
  }

  /**
   * @param {number | null} min
   * @param {number | null} max
   * @returns {[number, number]}
   */
  _range(min, max) {
    let [low, high] = [min ?? 0, max ?? 1];
    if (this.plot.isFromZero) {
      low = Math.min(0, low);
    }
    const missing = Math.max(0, LEAST_RANGE - (high - low));
    low -= this.plot.isFromZero ? 0 : missing / 2;
    high += this.plot.isFromZero ? missing : missing / 2;
    const margin = 0.06 * (high - low);
    return [this.plot.isFromZero ? low : low - margin, high + margin];
  }

  /**
   * A flag with its words at each mark.
   * @param {uPlot} plot
   */
  _flag({ ctx, bbox, scales, valToPos }) {
    const { min = 0, max = 0 } = scales.x;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = css("accent");
    ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    for (const [index, one] of this._marks.entries()) {
      const seconds = momentOf(one) / 1000;
      if (seconds >= min && seconds <= max) {
        const x = valToPos(seconds, "x", true);
        ctx.strokeRect(x, bbox.top, 0, bbox.height);
        const row = (index % FLAG_ROWS) + 1;
        ctx.fillText(`⚑ ${wordsOf(one).slice(0, 24)}`, x + 3, bbox.top + 13 * row * devicePixelRatio);
      }
    }
    ctx.restore();
  }

  /** @param {uPlot} plot */
  _select(plot) {
    const { left, width } = plot.select;
    if (width > 4) {
      const from = plot.posToVal(left, "x");
      this._onZoom({ from, to: plot.posToVal(left + width, "x") });
    }
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }
}
