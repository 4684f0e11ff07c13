// SPDX-License-Identifier: MIT
// @ts-check
// Readings of the magnetometer, raw and corrected, in three planes and in space, with the
// fitted ellipsoid: figure 4 of the NECTEC paper.

import { make, say } from "../dom.js";

/** @typedef {readonly number[]} Vector */
/** @typedef {{ matrix: readonly Vector[], bias_uT: Vector, norm_uT: number }} Ellipsoid */
/** @typedef {readonly [Vector, Vector]} Plane two rows: to the right, upwards */

const POINTS = 1200; // then every other one is left out
const APART_UT = 1.2; // closer to the last one, a reading shows nothing more
const LEAST_UT = 60; // half of what a panel shows at least
const SIZE = 150;
const STEPS = 72;
const DRAG = 0.01; // radians a pixel

/** @type {[string, Plane][]} */
const PLANES = [
  ["x right, y up", [[1, 0, 0], [0, 1, 0]]],
  ["x right, z up", [[1, 0, 0], [0, 0, 1]]],
  ["y right, z up", [[0, 1, 0], [0, 0, 1]]],
];

/**
 * @param {readonly Vector[]} matrix
 * @param {Vector} v
 */
function times(matrix, v) {
  return matrix.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);
}

/**
 * The inverse of a 3x3 matrix.
 * @param {readonly Vector[]} matrix
 */
export function inverse([[a, b, c], [d, e, f], [g, h, i]]) {
  const det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  return [
    [e * i - f * h, c * h - b * i, b * f - c * e],
    [f * g - d * i, a * i - c * g, c * d - a * f],
    [d * h - e * g, b * g - a * h, a * e - b * d],
  ].map((row) => row.map((value) => value / det));
}

/** A card with four panels. */
export class Cloud {
  constructor() {
    /** @type {number[][]} */
    this._points = [];
    this._isDirty = true;
    /** @type {Ellipsoid | null} */
    this._ellipsoid = null;
    this._view = { turn: 0.7, lift: 0.45 };
    this._panels = [...PLANES.map(([name]) => name), "in space"].map((name) => {
      const canvas = make("canvas", { width: SIZE, height: SIZE, role: "img", "aria-label": name });
      return { canvas, figure: make("figure", {}, canvas, make("figcaption", {}, name)) };
    });
    this._panels[3].canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) {
        this._view.turn += DRAG * event.movementX;
        this._view.lift = Math.max(-1.5, Math.min(1.5, this._view.lift + DRAG * event.movementY));
        this._isDirty = true;
      }
    });
    this._scale = make("span", { class: "muted small" });
    this.element = make(
      "div",
      { class: "card cloud" },
      make("div", { class: "card-head" }, make("h2", {}, "Magnetometer"), this._scale),
      make("div", { class: "panels" }, ...this._panels.map(({ figure }) => figure)),
      make(
        "p",
        { class: "small row" },
        make("span", { class: "key raw" }, "as read, with the fitted ellipsoid"),
        make("span", { class: "key right" }, "corrected, with its sphere"),
      ),
    );
  }

  clear() {
    this._points = [];
    this._isDirty = true;
  }

  /** @param {Vector} reading in microtesla, as read */
  add(reading) {
    const last = this._points[this._points.length - 1];
    if (last && Math.hypot(...reading.map((value, axis) => value - last[axis])) < APART_UT) {
      return;
    }
    if (this._points.length >= POINTS) {
      this._points = this._points.filter((_, index) => index % 2 === 0);
    }
    this._points.push([...reading]);
    this._isDirty = true;
  }

  /** @param {Ellipsoid | null} ellipsoid */
  fit(ellipsoid) {
    if (ellipsoid !== this._ellipsoid) {
      this._ellipsoid = ellipsoid;
      this._isDirty = true;
    }
  }

  recolour() {
    this._isDirty = true;
  }

  /** Draws what has changed. */
  draw() {
    if (!this._isDirty) {
      return;
    }
    this._isDirty = false;
    const fit = this._ellipsoid;
    const corrected = fit === null ? [] : this._points.map((point) => this._corrected(point, fit));
    const all = [...this._points, ...corrected];
    const reach = all.reduce((most, point) => Math.max(most, Math.hypot(...point)), LEAST_UT);
    say(this._scale, `to the edge ${Math.round(1.08 * reach)} µT`);
    const planes = [...PLANES.map(([, plane]) => plane), this._space()];
    planes.forEach((plane, index) => {
      this._panel(this._panels[index].canvas, plane, 1.08 * reach, corrected);
    });
  }

  /**
   * @param {Vector} point
   * @param {Ellipsoid} fit
   */
  _corrected(point, fit) {
    return times(fit.matrix, point.map((value, axis) => value - fit.bias_uT[axis]));
  }

  /** @returns {Plane} as seen from a side and from above */
  _space() {
    const { turn, lift } = this._view;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    return [
      [-s, c, 0],
      [-c * Math.sin(lift), -s * Math.sin(lift), Math.cos(lift)],
    ];
  }

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Plane} plane
   * @param {number} reach
   * @param {readonly Vector[]} corrected
   */
  _panel(canvas, plane, reach, corrected) {
    const ratio = Math.min(2, devicePixelRatio);
    canvas.width = canvas.height = SIZE * ratio;
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const style = getComputedStyle(canvas);
    const colour = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`);
    const half = canvas.width / 2;
    /** @param {Vector} point @returns {[number, number]} */
    const at = (point) => {
      const [right, up] = times(plane, point);
      return [half + (right / reach) * half, half - (up / reach) * half];
    };
    context.strokeStyle = colour("line");
    for (const axis of [[reach, 0, 0], [0, reach, 0], [0, 0, reach]]) {
      context.beginPath();
      context.moveTo(...at(axis.map((value) => -value)));
      context.lineTo(...at(axis));
      context.stroke();
    }
    const dots = (/** @type {readonly Vector[]} */ points, /** @type {string} */ name) => {
      context.fillStyle = colour(name);
      for (const point of points) {
        const [x, y] = at(point);
        context.fillRect(x - ratio * 0.9, y - ratio * 0.9, 1.8 * ratio, 1.8 * ratio);
      }
    };
    dots(this._points, "warn");
    dots(corrected, "accent");
    if (this._ellipsoid !== null) {
      const { matrix, bias_uT: bias, norm_uT: norm } = this._ellipsoid;
      const shape = inverse(matrix).map((row) => row.map((value) => value * norm));
      const sphere = [[norm, 0, 0], [0, norm, 0], [0, 0, norm]];
      context.lineWidth = 1.4 * ratio;
      outline(context, shape, bias, plane, at, colour("warn"));
      outline(context, sphere, [0, 0, 0], plane, at, colour("accent"));
    }
  }
}

/**
 * The edge of an ellipsoid as it is seen: for each direction n in the plane, the point
 * B B'n / |B'n| of the projected shape B.
 * @param {CanvasRenderingContext2D} context
 * @param {readonly Vector[]} shape it is the unit sphere times this
 * @param {Vector} middle
 * @param {Plane} plane
 * @param {(point: Vector) => [number, number]} at
 * @param {string} colour
 */
function outline(context, shape, middle, plane, at, colour) {
  context.strokeStyle = colour;
  context.beginPath();
  for (let step = 0; step <= STEPS; step++) {
    const angle = (2 * Math.PI * step) / STEPS;
    const n = plane[0].map((_, k) => Math.cos(angle) * plane[0][k] + Math.sin(angle) * plane[1][k]);
    const v = [0, 1, 2].map((k) => shape[0][k] * n[0] + shape[1][k] * n[1] + shape[2][k] * n[2]);
    const length = Math.hypot(...v) || 1;
    const edge = times(shape, v.map((value) => value / length));
    context.lineTo(...at(edge.map((value, axis) => value + middle[axis])));
  }
  context.stroke();
}
