// SPDX-License-Identifier: MIT
// @ts-check
// How far a pose is from a desired orientation, and whether that is sure enough. All of
// it by quaternions, so that it holds at any attitude.

import {
  angleBetween,
  angleOf,
  DEGREES,
  inverse,
  multiply,
  rotate,
  toAngles,
  wrapped,
} from "../rotation.js";

/** @typedef {import("../rotation.js").Quat} Quat */
/** @typedef {import("../rotation.js").Vector} Vector */
/** @typedef {import("../rotation.js").Convention} Convention */
/** @typedef {import("../model.js").Pose} Pose */
/** @typedef {import("../model.js").Aim} Aim */
/** @typedef {"x" | "y" | "z" | "all"} Axis what has to agree: one axis, or the attitude */

/**
 * @typedef {object} Target
 * @property {string} name
 * @property {Quat} q
 * @property {Axis} axis
 * @property {number} tolerance_deg
 * @property {number} hold_s
 * @property {string} [capture] how the daemon names the moment when it was captured
 */

/**
 * @typedef {object} Doubt
 * @property {number | null} sigma one sigma of the error, degrees; null: not known
 * @property {"origin" | "capture" | null} since of errors since then; null: absolute ones
 * @property {string | null} lost why it is not since then, where it should be
 */

/**
 * @typedef {object} Verdict
 * @property {number} error degrees
 * @property {number | null} sigma one sigma of the error, degrees; null: not known
 * @property {"origin" | "capture" | null} since
 * @property {string | null} lost
 * @property {"reached" | "unsure" | "off"} state
 * @property {{ yaw: number, pitch: number, roll: number }} differences degrees
 * @property {[number, number]} offset where the axis is, right and up of the target, in
 *   degrees as seen along the target's axis
 * @property {number} twist about the axis, degrees
 */

export const SIGMAS = 2; // that an aim has to be sure by
// An axis this close to the vertical (its sine) does not depend on the heading.
const UPRIGHT = 0.01;

/** @type {Record<Exclude<Axis, "all">, Vector>} */
const DIRECTIONS = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

/**
 * The body's direction that an axis names; the whole attitude is shown by its x.
 * @param {Axis} axis
 */
export function directionOf(axis) {
  return DIRECTIONS[axis === "all" ? "x" : axis];
}

// The daemon's word on a pose this much older or newer holds for it, too.
const NEAR_POSES = 40;

/**
 * How sure the error is. The daemon says it of the target that it was given, which it
 * relates to the moment when that was captured; of others, the pose itself.
 * @param {Pose} pose
 * @param {Target} target
 * @param {Aim | null} aim
 * @returns {Doubt}
 */
export function doubtOf(pose, target, aim) {
  if (aim !== null && aim.since !== undefined && isOf(aim, target, pose)) {
    return { sigma: aim.sigma_deg, since: aim.since, lost: aim.void ?? null };
  }
  const since = pose.since_origin ?? null;
  if (since !== null && since.void === null) {
    return { sigma: sigmaOf(pose, since, target.axis, 1), since: "origin", lost: null };
  }
  // The error of the origin also counts, and is about as large.
  const ends = pose.flags.includes("tared") ? Math.SQRT2 : 1;
  return {
    sigma: sigmaOf(pose, pose, target.axis, ends),
    since: null,
    lost: since?.void ?? null,
  };
}

/**
 * @param {Aim} aim
 * @param {Target} target
 * @param {Pose} pose
 */
function isOf(aim, target, pose) {
  return (
    aim.target === nameOf(target) &&
    aim.axis === target.axis &&
    Math.abs(aim.number - pose.number) <= NEAR_POSES &&
    aim.target_q.every((part, index) => Math.abs(part - target.q[index]) < 1e-6)
  );
}

/**
 * Its name as a parameter of a command.
 * @param {Target} target
 */
export function nameOf(target) {
  return target.name.replaceAll(";", ",");
}

/**
 * One sigma of the error, from those of tilt and heading, which are independent.
 * @param {Pose} pose
 * @param {{ tilt_sigma_deg: number | null, heading_sigma_deg: number | null }} sigmas
 * @param {Axis} axis
 * @param {number} ends by how much larger they are, as both ends are wrong
 */
function sigmaOf(pose, sigmas, axis, ends) {
  const { tilt_sigma_deg: known, heading_sigma_deg: turn } = sigmas;
  if (known === null) {
    return null;
  }
  const tilt = ends * known;
  // An origin of its own may mix absolute errors: then all of both counts.
  const isMixed = axis === "all" || ends > 1;
  const [east, north] = rotate(pose.q, directionOf(axis));
  const share = isMixed ? 1 : Math.hypot(east, north);
  if (share < UPRIGHT) {
    return tilt;
  }
  return turn === null ? null : Math.hypot(tilt, share * ends * turn);
}

/**
 * @param {Pose} pose
 * @param {Target} target
 * @param {Convention} convention of the differences
 * @param {Aim | null} aim
 * @returns {Verdict}
 */
export function judge(pose, target, convention, aim) {
  const { axis, q, tolerance_deg: tolerance } = target;
  const direction = directionOf(axis);
  const is = rotate(pose.q, direction);
  const should = rotate(q, direction);
  const error =
    axis === "all" ? angleOf(multiply(pose.q, inverse(q))) : angleBetween(is, should);
  const { sigma, since, lost } = doubtOf(pose, target, aim);
  const isSure = sigma !== null && error + SIGMAS * sigma <= tolerance;
  const mine = toAngles(pose.q, convention);
  const wanted = toAngles(q, convention);
  const relative = multiply(inverse(q), pose.q);
  const along = relative[1] * direction[0] + relative[2] * direction[1] + relative[3] * direction[2];
  return {
    error,
    sigma,
    since,
    lost,
    state: isSure ? "reached" : error <= tolerance ? "unsure" : "off",
    differences: {
      yaw: wrapped(mine.yaw - wanted.yaw),
      pitch: mine.pitch - wanted.pitch,
      roll: wrapped(mine.roll - wanted.roll),
    },
    offset: offsetOf(is, should),
    twist: wrapped(2 * Math.atan2(along, relative[0]) * DEGREES),
  };
}

/**
 * Where a direction is as seen along another: right and up, in degrees of the angle
 * between them. Up is the world's, or north where one looks up or down.
 * @param {Vector} is
 * @param {Vector} along
 * @returns {[number, number]}
 */
function offsetOf(is, along) {
  const isUpright = Math.abs(along[2]) > 0.95;
  const up = perpendicular(isUpright ? [0, 1, 0] : [0, 0, 1], along);
  const right = cross(along, up);
  const [x, y] = [dot(is, right), dot(is, up)];
  const length = Math.hypot(x, y);
  const angle = angleBetween(is, along);
  return length > 1e-9 ? [(angle * x) / length, (angle * y) / length] : [0, angle > 90 ? angle : 0];
}

/**
 * @param {Vector} a
 * @param {Vector} b
 */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}

/**
 * The part of `a` across `b`, of length one.
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
function perpendicular(a, b) {
  const along = dot(a, b);
  const [x, y, z] = [a[0] - along * b[0], a[1] - along * b[1], a[2] - along * b[2]];
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}
