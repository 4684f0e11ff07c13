// SPDX-License-Identifier: MIT
// @ts-check
// The strokes of the selected probe since its origin: where each ended, and how surely.

/** @typedef {import("./link.js").Line} Line */
/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./rotation.js").Vector} Vector */

/**
 * @typedef {object} Stop where a stroke ended, in the world from the origin
 * @property {Vector} at metres: of the tip, or of the sensor without a tip
 * @property {Vector | null} sigma metres, of each axis
 */

const STOPS_MAX = 60;
const SAME_M = 0.001; // a stroke that begins farther from the last end is on a new path

/** Follows one probe. */
export class Strokes {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    /** @type {Stop[]} */
    this.stops = [];
    /** @type {Vector | null} */
    this.running = null; // where a stroke that has not ended is
    /** @type {Line | null} */
    this.last = null; // the last message
    /** @type {Line | null} */
    this.closing = null; // the path as the daemon has closed it, until the next stroke
    this.version = 0; // changes when there is more to draw
    this._probe = "";
    /** @type {Vector | null} */
    this._path = null; // of the sensor, at the last end
    model.addEventListener("probe", (event) => {
      this._hear(/** @type {CustomEvent<Line>} */ (event).detail);
    });
    model.addEventListener("reset", () => this.clear());
  }

  clear() {
    this.stops = [];
    this.running = this.last = this.closing = this._path = null;
    this.version += 1;
  }

  /** @param {Line} line */
  _hear(line) {
    const { selected, probe } = this._model;
    if (selected !== this._probe) {
      this._probe = selected;
      this.clear();
    }
    if (line.probe === selected && line.type === "path") {
      this.closing = line;
      this.version += 1;
    } else if (line.probe === selected && line.type === "stroke") {
      this._take(line, probe?.pose?.position_m ?? line.path_m);
    }
  }

  /**
   * @param {Line} line
   * @param {Vector | null} at
   */
  _take(line, at) {
    this.last = line;
    this.closing = null;
    this.version += 1;
    const { path_m: path, displacement_m: moved } = line;
    this.running = null;
    if (path === null || at === null) {
      this.stops = [];
      this._path = null;
      return;
    }
    const begin = moved ? minus(path, moved) : path;
    if (this._path === null || Math.hypot(...minus(begin, this._path)) > SAME_M) {
      this._path = begin;
      this.stops = [{ at: moved ? minus(at, moved) : at, sigma: null }];
    }
    if (line.end === "running") {
      this.running = at;
    } else {
      this._path = path;
      this.stops.push({ at, sigma: line.path_sigma_m });
      this.stops.splice(0, this.stops.length - STOPS_MAX);
    }
  }
}

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
function minus([a, b, c], [x, y, z]) {
  return [a - x, b - y, c - z];
}
