// SPDX-License-Identifier: MIT
// @ts-check
// The path of the probe's nose over its last directions, fading out.

import * as three from "../vendor/three/three.module.min.js";

const APART = 0.004; // a nose at rest adds no points
const JUMP = 0.4; // poses were missing in between

/** A line that grows at one end and vanishes at the other. */
export class Trail {
  /** @param {number} points that it has at most: 180 are three seconds at 60 poses a second */
  constructor(points) {
    this._points = points;
    this._places = new Float32Array(3 * points);
    this._colours = new Float32Array(4 * points);
    this._geometry = new three.BufferGeometry();
    const { BufferAttribute } = three;
    this._geometry.setAttribute("position", new BufferAttribute(this._places, 3));
    this._geometry.setAttribute("color", new BufferAttribute(this._colours, 4));
    this._geometry.setDrawRange(0, 0);
    this._count = 0;
    const material = new three.LineBasicMaterial({ vertexColors: true, transparent: true });
    this.line = new three.Line(this._geometry, material);
    this.line.frustumCulled = false;
  }

  /** @param {import("./scene.js").Colours} colours */
  recolour(colours) {
    const colour = new three.Color(colours.warn);
    for (let i = 0; i < this._points; i++) {
      this._colours.set([colour.r, colour.g, colour.b, (i + 1) / this._points], 4 * i);
    }
    this._geometry.getAttribute("color").needsUpdate = true;
  }

  /** @param {readonly [number, number, number] | null} place null: no trail */
  add(place) {
    if (place === null) {
      this._count = 0;
    } else if (this._count === 0 || this._moved(place) > APART) {
      this._count = this._moved(place) > JUMP ? 0 : this._count;
      // Points are at the end of the arrays, where the colours are opaque.
      this._places.copyWithin(0, 3);
      this._places.set(place, 3 * (this._points - 1));
      this._count = Math.min(this._points, this._count + 1);
      this._geometry.getAttribute("position").needsUpdate = true;
    }
    this._geometry.setDrawRange(this._points - this._count, this._count);
  }

  /**
   * How far that is from the last point.
   * @param {readonly [number, number, number]} place
   */
  _moved([x, y, z]) {
    const last = 3 * (this._points - 1);
    const [a, b, c] = this._places.subarray(last, last + 3);
    return Math.hypot(x - a, y - b, z - c);
  }
}
