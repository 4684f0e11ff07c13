// SPDX-License-Identifier: MIT
// @ts-check
// A limb in 3D: a rod for each segment, a ball for each joint. x is ahead, z up. Missing
// segments are not drawn: a label says so at the joint where they would begin.

import * as three from "../vendor/three/three.module.min.js";
import { arrow, matt, segments, word } from "../scene/parts.js";
import { coloursOf } from "../scene/scene.js";
import { View3d } from "../scene/view3d.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../rotation.js").Vector} Vector */

const HEIGHT = 2.1; // of a limb in the picture
const THICK = 0.035;
const FADED = 0.3;
const UP = new three.Vector3(0, 1, 0);

/**
 * The rods of a segment: from its start to its end, and on to its marks.
 * @param {Line} segment
 * @returns {[Vector, Vector][]} metres
 */
export function rodsOf({ start_m: start, end_m: end, marks_m: marks }) {
  if (!start || !end) {
    return [];
  }
  /** @type {[Vector, Vector][]} */
  const rods = [[start, end]];
  for (const mark of /** @type {Vector[]} */ (Object.values(marks))) {
    rods.push([end, mark], [start, mark]);
  }
  return rods;
}

/**
 * What is said of segments that are not drawn, and where the first of them would begin: at
 * the end of its parent, else at the origin.
 * @param {Line} state
 * @returns {{ words: string, at: Vector }[]}
 */
export function missingOf(state) {
  if (!state.aligned) {
    return [{ words: "not aligned yet", at: [0, 0, 0] }];
  }
  /** @type {Map<string, { name: string, at: Vector }>} */
  const found = new Map();
  const byName = new Map(state.segments.map((/** @type {Line} */ one) => [one.name, one]));
  for (const { name, parent, start_m: start } of state.segments) {
    const before = found.get(parent);
    if (start) {
      continue;
    }
    if (before) {
      before.name += `, ${name}`;
      found.set(name, before);
    } else {
      found.set(name, { name, at: byName.get(parent)?.end_m ?? [0, 0, 0] });
    }
  }
  return [...new Set(found.values())].map(({ name, at }) => ({ words: `${name} missing`, at }));
}

/**
 * The length of a limb, with all its segments stretched out, m.
 * @param {Line} state
 */
export function lengthOf(state) {
  let sum = 0;
  for (const { start_m: start, end_m: end } of state.segments) {
    sum += start && end ? Math.hypot(...minus(end, start)) : 0;
  }
  return sum;
}

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {[number, number, number]}
 */
function minus([a, b, c], [x, y, z]) {
  return [a - x, b - y, c - z];
}

/** Owns a canvas that fills its parent. */
export class Figure extends View3d {
  /** @param {HTMLElement} parent */
  constructor(parent) {
    super(parent);
    this.limb = new three.Group(); // in metres
    this._words = new three.Group();
    this._world = new three.Group();
    this._scene.add(this.limb, this._words, this._world);
    this._length = 0; // the greatest so far, m
    this._isStale = false;
    /** @type {Line | null} */
    this._state = null;
    this.recolour();
  }

  /** Takes the theme's colours again. */
  recolour() {
    const colours = coloursOf();
    this._colours = colours;
    this._world.clear();
    /** @type {import("../scene/parts.js").Point[]} */
    const grid = [];
    for (let i = -4; i <= 4; i++) {
      const at = 0.3 * i;
      grid.push([at, -1.2, 0], [at, 1.2, 0], [-1.2, at, 0], [1.2, at, 0]);
    }
    this._world.add(
      segments(grid, colours.line),
      arrow([0.4, 0, 0], colours.x, 0.008),
      arrow([0, 0.4, 0], colours.y, 0.008),
      arrow([0, 0, 0.4], colours.z, 0.008),
      word("ahead", colours.x, [0.55, 0, 0.03], 0.1),
      word("left", colours.y, [0, 0.52, 0.03], 0.1),
      word("up", colours.z, [0, 0, 0.48], 0.1),
    );
    this._world.position.z = -1.15;
    this._build();
  }

  /**
   * Shows a state; a stale one is faded.
   * @param {Line} state
   * @param {boolean} isStale
   */
  show(state, isStale) {
    if (state === this._state && isStale === this._isStale) {
      return;
    }
    this._state = state;
    this._isStale = isStale;
    this._build();
  }

  _build() {
    const { _state: state, _colours: colours } = this;
    this._empty();
    if (state === null || colours === undefined) {
      return;
    }
    this._length = Math.max(this._length, lengthOf(state));
    const scale = HEIGHT / Math.max(0.1, this._length);
    const height = 0.5 * HEIGHT;
    this.limb.scale.setScalar(scale);
    this._words.position.z = this.limb.position.z = height - 0.1;
    const opacity = this._isStale ? FADED : 1;
    const bone = matt("#c9d0da", { opacity });
    const joint = matt(colours.accent, { opacity });
    const ground = matt(colours.good, { opacity });
    for (const segment of state.segments) {
      const isDown = segment.contact?.is_down === true;
      for (const [from, to] of rodsOf(segment)) {
        this._rod(from, to, isDown ? ground : bone, segment.name);
      }
      if (segment.start_m) {
        this._ball(segment.start_m, joint);
      }
    }
    for (const { words, at } of missingOf(state)) {
      const [x, y, z] = at;
      const place = /** @type {const} */ ([x * scale, y * scale, z * scale - 0.12]);
      this._words.add(word(words, colours.warn, place, 0.14));
    }
    this.invalidate();
  }

  _empty() {
    for (const child of this.limb.children) {
      /** @type {three.Mesh} */ (child).geometry.dispose();
    }
    for (const child of this._words.children) {
      const { material } = /** @type {three.Sprite} */ (child);
      material.map?.dispose();
      material.dispose();
    }
    this.limb.clear();
    this._words.clear();
  }

  /**
   * @param {Vector} from metres
   * @param {Vector} to
   * @param {three.Material} material
   * @param {string} name
   */
  _rod(from, to, material, name) {
    const along = new three.Vector3(...minus(to, from));
    const length = Math.max(1e-6, along.length());
    const thick = THICK / this.limb.scale.x;
    const rod = new three.Mesh(new three.CylinderGeometry(thick, thick, length, 10), material);
    rod.name = name;
    rod.position.set(...from).addScaledVector(along, 0.5);
    rod.quaternion.setFromUnitVectors(UP, along.normalize());
    this.limb.add(rod);
  }

  /**
   * @param {Vector} at metres
   * @param {three.Material} material
   */
  _ball(at, material) {
    const geometry = new three.SphereGeometry((1.7 * THICK) / this.limb.scale.x, 14, 10);
    const ball = new three.Mesh(geometry, material);
    ball.position.set(...at);
    this.limb.add(ball);
  }
}
