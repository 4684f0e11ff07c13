// SPDX-License-Identifier: MIT
// @ts-check
// Unit quaternions w, x, y, z, Hamilton, world_from_body, and angles in degrees: the same
// definitions as in docs/pose-details.md and imud/rotation.py.

/** @typedef {readonly [number, number, number, number]} Quat */
/** @typedef {readonly [number, number, number]} Vector */
/** @typedef {"nautical" | "aerospace" | "nectec"} Convention */
/** @typedef {{ yaw: number, pitch: number, roll: number }} Angles */

export const DEGREES = 180 / Math.PI;

/** @type {Quat} */
export const IDENTITY = [1, 0, 0, 0];

/** @type {readonly Convention[]} */
export const CONVENTIONS = ["nautical", "aerospace", "nectec"];

// Closer to the vertical than this, x is taken as vertical: host/imud/rotation.py.
const LOCK_RAD = 1e-5;

/**
 * The rotation `b` followed by `a`, both seen from the world.
 * @param {Quat} a
 * @param {Quat} b
 * @returns {Quat}
 */
export function multiply([aw, ax, ay, az], [bw, bx, by, bz]) {
  return [
    aw * bw - ax * bx - ay * by - az * bz,
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
  ];
}

/**
 * @param {Quat} q
 * @returns {Quat}
 */
export function inverse([w, x, y, z]) {
  return [w, -x, -y, -z];
}

/**
 * @param {Quat} q
 * @returns {Quat}
 */
export function normalized([w, x, y, z]) {
  const length = Math.hypot(w, x, y, z) || 1;
  return [w / length, x / length, y / length, z / length];
}

/**
 * The vector in the world that is `v` in the body.
 * @param {Quat} q
 * @param {Vector} v
 * @returns {Vector}
 */
export function rotate([w, x, y, z], [a, b, c]) {
  const tx = 2 * (y * c - z * b);
  const ty = 2 * (z * a - x * c);
  const tz = 2 * (x * b - y * a);
  return [
    a + w * tx + y * tz - z * ty,
    b + w * ty + z * tx - x * tz,
    c + w * tz + x * ty - y * tx,
  ];
}

/**
 * A rotation about the direction of a vector by its length, radians.
 * @param {Vector} v
 * @returns {Quat}
 */
export function fromRotationVector([x, y, z]) {
  const length = Math.hypot(x, y, z);
  const factor = length > 1e-12 ? Math.sin(length / 2) / length : 0.5;
  return [Math.cos(length / 2), x * factor, y * factor, z * factor];
}

/**
 * The angle of a rotation, degrees in [0, 180].
 * @param {Quat} q
 */
export function angleOf([w, x, y, z]) {
  return 2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)) * DEGREES;
}

/**
 * The angle between two vectors, degrees in [0, 180]; exact also where it is small.
 * @param {Vector} a
 * @param {Vector} b
 */
export function angleBetween([a, b, c], [x, y, z]) {
  const cross = Math.hypot(b * z - c * y, c * x - a * z, a * y - b * x);
  return Math.atan2(cross, a * x + b * y + c * z) * DEGREES;
}

/**
 * Degrees in [-180, 180).
 * @param {number} degrees
 */
export function wrapped(degrees) {
  return degrees - 360 * Math.floor((degrees + 180) / 360);
}

/**
 * @param {Quat} q
 * @returns {Angles}
 */
function nautical([w, x, y, z]) {
  let halfSum = Math.atan2(x + z, w - y);
  let halfDifference = Math.atan2(z - x, w + y);
  const sum = Math.hypot(x + z, w - y);
  const difference = Math.hypot(z - x, w + y);
  let pitch = Math.atan2(2 * (w * y - z * x), sum * difference) * DEGREES;
  if (sum < LOCK_RAD * Math.SQRT1_2) {
    halfSum = halfDifference;
    pitch = 90;
  } else if (difference < LOCK_RAD * Math.SQRT1_2) {
    halfDifference = halfSum;
    pitch = -90;
  }
  return {
    yaw: wrapped((halfSum + halfDifference) * DEGREES),
    pitch,
    roll: wrapped((halfSum - halfDifference) * DEGREES),
  };
}

/**
 * Yaw, pitch and roll in degrees: yaw and roll in [-180, 180), pitch in [-90, 90].
 * @param {Quat} q
 * @param {Convention} convention
 * @returns {Angles}
 */
export function toAngles(q, convention) {
  const { yaw, pitch, roll } = nautical(q);
  if (convention === "aerospace") {
    return { yaw: wrapped(90 - yaw), pitch: -pitch, roll };
  }
  return convention === "nectec" ? { yaw: roll, pitch, roll: yaw } : { yaw, pitch, roll };
}

/**
 * @param {Angles} angles in degrees
 * @param {Convention} convention
 * @returns {Quat}
 */
export function fromAngles({ yaw, pitch, roll }, convention) {
  let [z, y, x] = [yaw, pitch, roll];
  if (convention === "aerospace") {
    [z, y] = [90 - yaw, -pitch];
  } else if (convention === "nectec") {
    [z, x] = [roll, yaw];
  }
  const aboutZ = fromRotationVector([0, 0, z / DEGREES]);
  const aboutY = fromRotationVector([0, y / DEGREES, 0]);
  const aboutX = fromRotationVector([x / DEGREES, 0, 0]);
  return multiply(aboutZ, multiply(aboutY, aboutX));
}

/**
 * The compass heading of the body's x axis, degrees clockwise from north in [0, 360);
 * null where x is within a degree of the vertical.
 * @param {Quat} q
 */
export function heading(q) {
  const [east, north] = rotate(q, [1, 0, 0]);
  if (Math.hypot(east, north) < 0.0175) {
    return null;
  }
  return (Math.atan2(east, north) * DEGREES + 360) % 360;
}
