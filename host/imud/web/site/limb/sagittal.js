// SPDX-License-Identifier: MIT
// @ts-check
// The limb in the sagittal plane, x ahead and z up, as Rozanowski's paper draws it: as it
// is, where it was in the last two seconds, and the path of its last end.

import { make } from "../dom.js";
import { lengthOf, missingOf, rodsOf } from "./figure.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../rotation.js").Vector} Vector */

const KEPT_NS = 2e9;
const GHOST_NS = 0.12e9; // between two figures of the past
const MARGIN = 26; // pixels

/** A card with a drawing. */
export class Sagittal {
  constructor() {
    this._canvas = make("canvas", { role: "img", "aria-label": "Limb in the sagittal plane" });
    this._length = 0;
    /** @type {Line[]} */
    this._past = [];
    this.element = make(
      "div",
      { class: "card" },
      make("h2", {}, "Sagittal plane, m"),
      make("div", { class: "plane" }, this._canvas),
    );
  }

  /** @param {Line} state */
  add(state) {
    this._past = this._past.filter(({ t_ns: time }) => {
      return time < state.t_ns && time > state.t_ns - KEPT_NS;
    });
    this._past.push(state);
    this._length = Math.max(this._length, lengthOf(state));
  }

  clear() {
    this._past = [];
    this._length = 0;
  }

  /** @param {boolean} isStale */
  draw(isStale) {
    const box = /** @type {HTMLElement} */ (this._canvas.parentElement);
    const [width, height] = [box.clientWidth, box.clientHeight];
    const context = this._canvas.getContext("2d");
    if (!context || width < 10) {
      return;
    }
    const ratio = devicePixelRatio;
    this._canvas.width = width * ratio;
    this._canvas.height = height * ratio;
    const reach = Math.max(0.2, this._length);
    const scale = Math.min((height - 2 * MARGIN) / (1.1 * reach), width / (2 * reach));
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const style = getComputedStyle(document.documentElement);
    const colour = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`).trim();
    const place = (/** @type {Vector} */ [x, , z]) => {
      return /** @type {const} */ ([width / 2 + x * scale, MARGIN - z * scale]);
    };
    this._grid(context, width, height, scale, colour);
    let last = -Infinity;
    for (const state of this._past.slice(0, -1)) {
      if (state.t_ns - last >= GHOST_NS) {
        last = state.t_ns;
        figure(context, state, place, colour("line"), colour("line"), 2);
      }
    }
    this._path(context, place, colour("warn"));
    const state = this._past.at(-1);
    if (state === undefined) {
      return;
    }
    context.globalAlpha = isStale ? 0.35 : 1;
    figure(context, state, place, colour("ink"), colour("good"), 4);
    context.globalAlpha = 1;
    context.font = "600 13px system-ui, sans-serif";
    context.fillStyle = colour("warn");
    for (const { words, at } of missingOf(state)) {
      const [x, y] = place(at);
      context.fillText(words, x + 8, y + 16);
    }
  }

  /**
   * Lines a quarter of a metre apart.
   * @param {CanvasRenderingContext2D} context
   * @param {number} width
   * @param {number} height
   * @param {number} scale
   * @param {(name: string) => string} colour
   */
  _grid(context, width, height, scale, colour) {
    context.strokeStyle = colour("line");
    context.fillStyle = colour("muted");
    context.font = "12px system-ui, sans-serif";
    context.lineWidth = 1;
    const step = 0.25;
    for (let z = 0; MARGIN + z * scale < height; z += step) {
      line(context, [0, MARGIN + z * scale], [width, MARGIN + z * scale]);
      context.fillText(z ? `\u2212${z.toFixed(2)}` : "0.00", 4, MARGIN + z * scale - 3);
    }
    for (let x = step; x * scale < width / 2; x += step) {
      for (const at of [width / 2 + x * scale, width / 2 - x * scale]) {
        line(context, [at, 0], [at, height]);
      }
    }
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {(at: Vector) => readonly [number, number]} place
   * @param {string} colour
   */
  _path(context, place, colour) {
    context.strokeStyle = colour;
    context.lineWidth = 1.5;
    /** @type {readonly [number, number] | null} */
    let before = null;
    for (const state of this._past) {
      const end = state.segments.at(-1)?.end_m;
      const at = end ? place(end) : null;
      if (at && before) {
        line(context, before, at);
      }
      before = at;
    }
  }
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Line} state
 * @param {(at: Vector) => readonly [number, number]} place
 * @param {string} colour
 * @param {string} grounded of a segment that stands on the ground
 * @param {number} width
 */
function figure(context, state, place, colour, grounded, width) {
  context.lineWidth = width;
  context.lineCap = "round";
  for (const segment of state.segments) {
    context.strokeStyle = segment.contact?.is_down ? grounded : colour;
    for (const [from, to] of rodsOf(segment)) {
      line(context, place(from), place(to));
    }
  }
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {readonly [number, number]} from
 * @param {readonly [number, number]} to
 */
function line(context, from, to) {
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
}
