// SPDX-License-Identifier: MIT
// @ts-check
// Numbers as text of constant width: a minus as wide as a digit, figure spaces in front.

const FIGURE_SPACE = "\u2007";
const MINUS = "\u2212";

/** Shown instead of an unknown number. */
export const UNKNOWN = "\u2013";

/**
 * A number with a fixed count of decimals, padded to a width in characters.
 * @param {number | null | undefined} value
 * @param {number} decimals
 * @param {number} [width]
 */
export function fixed(value, decimals, width = 0) {
  if (value === null || value === undefined || !Number.isFinite(value)) {
    return UNKNOWN.padStart(width, FIGURE_SPACE);
  }
  const text = Math.abs(value).toFixed(decimals);
  const isNegative = value < 0 && Number(text) !== 0;
  return (isNegative ? MINUS + text : text).padStart(width, FIGURE_SPACE);
}

/**
 * An angle in degrees with two decimals.
 * @param {number | null | undefined} degrees
 */
export function angle(degrees) {
  return fixed(degrees, 2, 7);
}

/**
 * How many decimals a value deserves.
 * @param {number | null | undefined} error one sigma
 */
export function decimalsOf(error) {
  return error === null || error === undefined || error >= 10 ? 0 : error >= 1 ? 1 : 2;
}

/**
 * A one-sigma error in degrees.
 * @param {number | null | undefined} degrees
 */
export function sigma(degrees) {
  if (degrees === null || degrees === undefined) {
    return "unknown";
  }
  return `±${fixed(degrees, degrees < 10 ? 2 : 1)}°`;
}

/**
 * A time span in words: 0.42 s, 12 s, 3 min.
 * @param {number} seconds
 */
export function span(seconds) {
  if (!Number.isFinite(seconds)) {
    return UNKNOWN;
  }
  if (seconds < 10) {
    return `${fixed(seconds, 1)} s`;
  }
  if (seconds < 100) {
    return `${fixed(seconds, 0)} s`;
  }
  return seconds < 6000 ? `${fixed(seconds / 60, 0)} min` : `${fixed(seconds / 3600, 1)} h`;
}

/**
 * A whole number with groups of three digits.
 * @param {number | null | undefined} count
 */
export function whole(count) {
  if (count === null || count === undefined) {
    return UNKNOWN;
  }
  return Math.round(count)
    .toString()
    .replace(/\B(?=(\d{3})+$)/g, "\u202f");
}

/**
 * Microseconds in the unit that suits.
 * @param {number | null | undefined} us
 */
export function micros(us) {
  if (us === null || us === undefined) {
    return UNKNOWN;
  }
  return us < 1e6 ? `${fixed(us / 1000, us < 1e5 ? 1 : 0)} ms` : span(us / 1e6);
}
