// SPDX-License-Identifier: MIT
// @ts-check
// The next pose: a pale copy of the probe in the nearest fitting attitude, and an arrow for
// the turn that leads there.

import * as three from "../vendor/three/three.module.min.js";
import { fromRotationVector, multiply, rotate } from "../rotation.js";
import { makeProbe } from "../scene/bodies.js";
import { flat } from "../scene/parts.js";
import { RADIUS } from "./cover.js";

/** @typedef {import("../rotation.js").Quat} Quat */
/** @typedef {import("../rotation.js").Vector} Vector */
/** @typedef {import("../scene/scene.js").Colours} Colours */

const STEPS = 32;
const ALIKE_RAD = 0.15; // so near it is there: no ghost, no arrow
const HEAD = 0.09; // length of the arrow's head
/** @type {Vector} */
const UP = [0, 0, 1];

/**
 * The turn that brings a direction of the body up, as a rotation vector in the world; by
 * the shortest way, and about any level axis where it points down.
 * @param {Quat} q world_from_body
 * @param {Vector} wanted direction in the body
 * @returns {Vector}
 */
export function turnTo(q, wanted) {
  const [x, y, z] = rotate(q, wanted);
  const level = Math.hypot(x, y);
  const angle = Math.atan2(level, z);
  return level < 1e-6 ? [angle, 0, 0] : [(angle * y) / level, (-angle * x) / level, 0];
}

/** Stands in the world, beside the probe. */
export class Ghost {
  constructor() {
    this.group = new three.Group();
    this._body = new three.Group();
    this._arc = new three.Mesh(new three.BufferGeometry(), flat("#888888", 0.9));
    this._head = new three.Mesh(new three.ConeGeometry(HEAD / 2.4, HEAD, 16), flat("#888888", 0.9));
    this.group.add(this._body, this._arc, this._head);
    this.group.visible = false;
    this._shownKey = "";
  }

  /** @param {Colours} colours */
  recolour(colours) {
    this._body.clear();
    this._body.add(makeProbe(colours));
    this._body.traverse((part) => {
      part.visible = !(part instanceof three.Sprite); // its letters are the probe's
      const material = /** @type {any} */ (part).material;
      if (material) {
        material.transparent = true;
        material.depthWrite = false;
        material.opacity = 0.3;
        material.color.set(colours.accent);
      }
    });
    this._arc.material.color.set(colours.accent);
    this._head.material.color.set(colours.accent);
    this._shownKey = "";
  }

  /**
   * Shows the next pose from an attitude; returns whether that has changed.
   * @param {Quat | null} q null: nothing to show
   * @param {Vector | null} wanted the direction of the body that should be up
   * @param {boolean} isHalfTurn it should be turned by half a turn where it lies
   */
  show(q, wanted, isHalfTurn) {
    const turn = q === null ? null : isHalfTurn ? [0, 0, Math.PI] : wanted && turnTo(q, wanted);
    const isNear = turn !== null && Math.hypot(...turn) < ALIKE_RAD;
    const key = turn === null || isNear ? "" : [...(q ?? []), ...turn].map((part) => part.toFixed(2)).join(" ");
    if (key === this._shownKey) {
      return false;
    }
    this._shownKey = key;
    this.group.visible = key !== "";
    if (q !== null && turn !== null && key !== "") {
      const [w, x, y, z] = multiply(fromRotationVector(/** @type {Vector} */ (turn)), q);
      this._body.quaternion.set(x, y, z, w);
      const from = isHalfTurn ? rotate(q, [1, 0, 0]) : rotate(q, wanted ?? UP);
      this._draw(new three.Vector3(...from), new three.Vector3(...turn));
    }
    return true;
  }

  /**
   * The arrow: where a point of the sphere goes.
   * @param {three.Vector3} from
   * @param {three.Vector3} turn a rotation vector
   */
  _draw(from, turn) {
    const angle = turn.length();
    const axis = turn.clone().normalize();
    const at = (/** @type {number} */ share) => from.clone().applyAxisAngle(axis, share * angle).multiplyScalar(RADIUS);
    const last = 1 - HEAD / (RADIUS * angle);
    const points = Array.from({ length: STEPS + 1 }, (_, step) => at((last * step) / STEPS));
    this._arc.geometry.dispose();
    const curve = new three.CatmullRomCurve3(points);
    this._arc.geometry = new three.TubeGeometry(curve, STEPS, 0.012, 8);
    const [end, before] = [at(1), at(last)];
    const along = end.clone().sub(before).normalize();
    this._head.position.copy(end.add(before).multiplyScalar(0.5));
    this._head.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), along);
  }
}
