// SPDX-License-Identifier: MIT
// @ts-check
// The rows of a history to draw: all rows of a window, or the least and greatest value
// of each bin where there are more rows than pixels.

/** @typedef {import("./history.js").History} History */

/**
 * Times and columns of a window, with a gap (null) where time jumps or an angle wraps.
 * Bins are at fixed times, so that a plot that moves does not flicker.
 * @param {History} history
 * @param {readonly number[]} columns
 * @param {number} from seconds
 * @param {number} to seconds
 * @param {number} bins
 * @param {number} wrap a step larger than this is a gap; Infinity: none is
 * @returns {[number[], ...(number | null)[][]]}
 */
export function reduce(history, columns, from, to, bins, wrap) {
  const first = Math.max(0, history.find(from) - 1);
  const end = Math.min(history.length, history.find(to) + 1);
  const step = (to - from) / bins;
  /** @type {number[]} */
  const times = [];
  /** @type {(number | null)[][]} */
  const series = columns.map(() => []);
  const isDense = end - first > 3 * bins;
  let row = first;
  while (row < end) {
    let next = row + 1;
    if (isDense) {
      const bin = Math.floor(history.time(row) / step);
      while (next < end && Math.floor(history.time(next) / step) === bin) {
        next += 1;
      }
    }
    addBin(history, columns, row, next, times, series, wrap);
    row = next;
  }
  return [times, ...series];
}

/**
 * One point for a row alone, two for several: the extremes in their order.
 * @param {History} history
 * @param {readonly number[]} columns
 * @param {number} row
 * @param {number} next
 * @param {number[]} times
 * @param {(number | null)[][]} series
 * @param {number} wrap
 */
function addBin(history, columns, row, next, times, series, wrap) {
  const begin = history.time(row);
  const isTwo = next - row > 1;
  const before = times.length ? times[times.length - 1] : begin;
  if (begin - before > Math.max(0.25, 6 * meanStep(history))) {
    times.push((before + begin) / 2);
    series.forEach((values) => values.push(null));
  }
  times.push(begin);
  if (isTwo) {
    times.push(history.time(next - 1));
  }
  columns.forEach((column, index) => {
    const values = series[index];
    let least = row;
    let greatest = row;
    for (let i = row + 1; i < next; i++) {
      const value = history.value(column, i);
      if (value < history.value(column, least)) {
        least = i;
      }
      if (value > history.value(column, greatest)) {
        greatest = i;
      }
    }
    let pair = least < greatest ? [least, greatest] : [greatest, least];
    if (history.value(column, greatest) - history.value(column, least) > wrap) {
      pair = [row, next - 1];
    }
    for (const one of isTwo ? pair : [row]) {
      const value = history.value(column, one);
      const last = values.length ? values[values.length - 1] : null;
      const isBroken = last !== null && Math.abs(value - last) > wrap;
      values.push(Number.isNaN(value) || isBroken ? null : value);
    }
  });
}

/** @param {History} history */
function meanStep(history) {
  const rows = history.length;
  const span = rows > 1 ? history.last - history.time(Math.max(0, rows - 200)) : 0;
  return span / Math.max(1, Math.min(rows - 1, 199));
}
