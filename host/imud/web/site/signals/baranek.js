// SPDX-License-Identifier: MIT
// @ts-check
// Baranek's filter, computed from raw samples: a rotation matrix stepped to first order,
// and two PI controllers whose outputs are the gyroscope's offsets. Equations 6 to 16 of
// his paper, read as in firmware/core/fusion/dcm_pi.h.

/** @typedef {[number, number, number]} Vector */

const GRAVITY = 9.80665;
// Gains of the paper, in counts of its gyroscope: 8.75 mdps, 100 samples a second.
const COUNT = (8.75e-3 * Math.PI) / 180;
const KP = 500 * COUNT; // rad/s
const KI = 0.1 * 100 * COUNT; // rad/s a second
const SUM_MAX = 1; // rad/s
const PART_S = 0.0075; // the matrix is repaired after each step of at most this

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}

/**
 * @param {Vector} v
 * @returns {Vector}
 */
function unit([x, y, z]) {
  const length = Math.hypot(x, y, z) || 1;
  return [x / length, y / length, z / length];
}

/** Steps with each sample; `error` and `offset` are those of the last one. */
export class DcmPi {
  constructor() {
    /** @type {[Vector, Vector, Vector] | null} the world's axes in the body */
    this.rows = null;
    this.sums = [0, 0];
    /** @type {[number, number]} of x and y, sines of angles */
    this.error = [NaN, NaN];
    /** @type {[number, number]} what the controllers take for the offsets, rad/s */
    this.offset = [NaN, NaN];
  }

  /**
   * @param {Vector} gyr rad/s
   * @param {Vector} acc m/s2
   * @param {number} seconds since the last sample
   */
  step(gyr, acc, seconds) {
    if (this.rows === null) {
      const z = unit(acc);
      const x = unit(cross(Math.abs(z[1]) > 0.9 ? [0, 0, 1] : [0, 1, 0], z));
      this.rows = [x, cross(z, x), z];
    }
    const error = cross(this.rows[2], unit(acc));
    const trust = Math.exp(-Math.abs(GRAVITY - Math.hypot(...acc)));
    this.error = [error[0], error[1]];
    this.sums = this.sums.map((sum, axis) =>
      Math.max(-SUM_MAX, Math.min(SUM_MAX, sum + KI * error[axis] * seconds)),
    );
    this.offset = [
      trust * (KP * error[0] + this.sums[0]),
      trust * (KP * error[1] + this.sums[1]),
    ];
    const parts = Math.max(1, Math.ceil(seconds / PART_S));
    const part = seconds / parts;
    for (let i = 0; i < parts; i++) {
      this._turn([
        (gyr[0] - this.offset[0]) * part,
        (gyr[1] - this.offset[1]) * part,
        gyr[2] * part,
      ]);
    }
  }

  /** @param {Vector} angle radians */
  _turn(angle) {
    const [x, y] = /** @type {[Vector, Vector, Vector]} */ (this.rows).slice(0, 2).map((row) => {
      const step = cross(row, angle);
      return /** @type {Vector} */ (row.map((value, k) => value + step[k]));
    });
    const half = (x[0] * y[0] + x[1] * y[1] + x[2] * y[2]) / 2;
    const apart = (/** @type {Vector} */ one, /** @type {Vector} */ other) =>
      /** @type {Vector} */ (one.map((value, k) => value - half * other[k]));
    const [a, b] = [apart(x, y), apart(y, x)];
    const repaired = (/** @type {Vector} */ row) => {
      const scale = (3 - (row[0] ** 2 + row[1] ** 2 + row[2] ** 2)) / 2;
      return /** @type {Vector} */ (row.map((value) => value * scale));
    };
    this.rows = [repaired(a), repaired(b), repaired(cross(a, b))];
  }
}
