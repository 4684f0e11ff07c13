// SPDX-License-Identifier: MIT
// @ts-check
// The directions of the probe that have been up so far, as spots on a sphere about it,
// and the one that should be up next.

import * as three from "../vendor/three/three.module.min.js";
import { flat } from "../scene/parts.js";

/** @typedef {import("../scene/scene.js").Colours} Colours */
/** @typedef {readonly [number, number, number]} Vector */

export const RADIUS = 1.18;
const SPOT = 0.05;
const ALIKE = Math.cos((25 * Math.PI) / 180);

/** Six faces, twelve edges, eight corners: as imud/calibration/poses.py has them. */
function directions() {
  const all = [];
  for (const x of [1, 0, -1]) {
    for (const y of [1, 0, -1]) {
      for (const z of [1, 0, -1]) {
        if (x || y || z) {
          all.push(new three.Vector3(x, y, z).normalize());
        }
      }
    }
  }
  return all;
}

/** The part that turns with the probe. */
export class Cover {
  constructor() {
    this.group = new three.Group();
    const ball = new three.SphereGeometry(SPOT, 14, 10);
    this._spots = directions().map((up) => {
      const spot = new three.Mesh(ball, flat("#888888"));
      spot.position.copy(up).multiplyScalar(RADIUS);
      return { up, spot };
    });
    this._shell = new three.Mesh(new three.SphereGeometry(RADIUS, 28, 18), flat("#888888", 0.07));
    this._shell.renderOrder = 1;
    this.group.add(this._shell, ...this._spots.map(({ spot }) => spot));
    /** @type {Colours | null} */
    this._colours = null;
    this._shownKey = "";
    /** @type {Vector | null} */
    this._wanted = null;
    /** @type {readonly Vector[]} */
    this._ups = [];
  }

  /** @param {Colours} colours */
  recolour(colours) {
    this._colours = colours;
    this._shell.material.color.set(colours.muted);
    this._paint();
  }

  /**
   * Shows what is covered and wanted; returns whether that has changed.
   * @param {readonly Vector[]} ups directions in the body that were up
   * @param {Vector | null} wanted
   */
  show(ups, wanted) {
    const key = JSON.stringify([ups, wanted]);
    if (key === this._shownKey) {
      return false;
    }
    this._shownKey = key;
    this._ups = ups;
    this._wanted = wanted;
    this._paint();
    return true;
  }

  /** How many of the directions are covered. */
  get covered() {
    return this._spots.filter(({ up }) => this._isCovered(up)).length;
  }

  /** @param {three.Vector3} up */
  _isCovered(up) {
    return this._ups.some(([x, y, z]) => up.x * x + up.y * y + up.z * z > ALIKE);
  }

  _paint() {
    if (this._colours === null) {
      return;
    }
    for (const { up, spot } of this._spots) {
      const [x, y, z] = this._wanted ?? [0, 0, 0];
      const isWanted = up.x * x + up.y * y + up.z * z > 0.999;
      const isCovered = this._isCovered(up);
      const { accent, good, muted } = this._colours;
      spot.material.color.set(isWanted ? accent : isCovered ? good : muted);
      spot.scale.setScalar(isWanted ? 2.1 : isCovered ? 1.3 : 0.7);
    }
  }
}
