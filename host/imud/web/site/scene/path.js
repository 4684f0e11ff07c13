// SPDX-License-Identifier: MIT
// @ts-check
// Where the tip has been: a line from stroke to stroke, and at the end of each an
// ellipsoid of two sigma; beside it the path that was closed.

import * as three from "../vendor/three/three.module.min.js";
import { flat } from "./parts.js";
import { RING } from "./world.js";

/** @typedef {import("../strokes.js").Strokes} Strokes */
/** @typedef {import("../rotation.js").Vector} Vector */

// Metres that the radius of the compass ring can stand for.
const RADII = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10];
const SIGMAS = 2;
const LEAST = 0.012; // a smaller ellipsoid can't be seen

const sphere = new three.SphereGeometry(1, 16, 10);

/** Belongs to a scene. */
export class Path {
  constructor() {
    this.group = new three.Group();
    /** Metres that the radius of the compass ring stands for; 0: nothing is drawn. */
    this.radius_m = 0;
    this._version = -1;
    this._colours = { accent: "#888888", warn: "#888888", good: "#888888" };
  }

  /** @param {import("./scene.js").Colours} colours */
  recolour(colours) {
    this._colours = colours;
    this._version = -1;
  }

  /** How long a metre is in the picture. */
  get scale() {
    return this.radius_m ? RING / this.radius_m : 0;
  }

  /**
   * Draws them; whether anything has changed.
   * @param {Strokes} strokes
   * @param {Vector | null} tip metres, in the world from the origin
   */
  show(strokes, tip) {
    const reach = Math.max(0, ...strokes.stops.map(reachOf), ...(tip ?? []).map(Math.abs));
    const isShown = strokes.stops.length > 0 || tip !== null;
    const fitting = RADII.find((radius) => reach < radius) ?? reach;
    const radius = isShown ? Math.max(fitting, tip ? this.radius_m : 0) : 0;
    if (radius === this.radius_m && strokes.version === this._version) {
      return false;
    }
    this.radius_m = radius;
    this._version = strokes.version;
    this._clear();
    this._line(strokes.stops.map(({ at }) => at), this._colours.accent);
    const last = strokes.stops.at(-1);
    if (strokes.running && last) {
      this._line([last.at, strokes.running], this._colours.warn);
    }
    if (strokes.closing?.closed_m) {
      this._line([[0, 0, 0], ...strokes.closing.closed_m], this._colours.good);
    }
    for (const { at, sigma } of strokes.stops) {
      this._ellipsoid(at, sigma ?? [0, 0, 0]);
    }
    return true;
  }

  _clear() {
    for (const child of this.group.children) {
      const { geometry, material } = /** @type {three.Mesh} */ (child);
      if (geometry !== sphere) {
        geometry.dispose();
      }
      /** @type {three.Material} */ (material).dispose();
    }
    this.group.clear();
  }

  /**
   * @param {Vector[]} points
   * @param {string} colour
   */
  _line(points, colour) {
    const places = points.map((point) => new three.Vector3(...point).multiplyScalar(this.scale));
    const geometry = new three.BufferGeometry().setFromPoints(places);
    this.group.add(new three.Line(geometry, new three.LineBasicMaterial({ color: colour })));
  }

  /**
   * @param {Vector} at
   * @param {Vector} sigma
   */
  _ellipsoid(at, sigma) {
    const mesh = new three.Mesh(sphere, flat(this._colours.accent, 0.35));
    const [x, y, z] = sigma.map((one) => Math.max(LEAST, SIGMAS * one * this.scale));
    mesh.scale.set(x, y, z);
    mesh.position.set(...at).multiplyScalar(this.scale);
    this.group.add(mesh);
  }
}

/** @param {import("../strokes.js").Stop} stop */
function reachOf({ at, sigma }) {
  return Math.max(...at.map((one, axis) => Math.abs(one) + SIGMAS * (sigma?.[axis] ?? 0)));
}
