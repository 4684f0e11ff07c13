// SPDX-License-Identifier: MIT
// @ts-check
// The params of a probe: its records from the parts that it tells, and what they say.

import { sizeOf, valueOf } from "./frames.js";
import { RECORDS } from "./wire.js";

/** @typedef {Record<string, Record<string, any>>} Records values of parts, by record */

const PART = 28; // bytes that a message tells
const SENSORS = { acc: "sigma_m_s2", gyr: "sigma", mag: "sigma_uT" };

/** @param {Uint8Array} bytes */
function crc32(bytes) {
  let crc = -1;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) {
      crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
    }
  }
  return ~crc >>> 0;
}

/**
 * @param {Uint8Array} bytes
 * @returns {Records}
 */
function recordsOf(bytes) {
  /** @type {Records} */
  const found = {};
  for (let at = 0; at + 2 <= bytes.length; at += 2 + bytes[at + 1]) {
    const kind = RECORDS[bytes[at]];
    const body = bytes.slice(at + 2, at + 2 + bytes[at + 1]);
    if (kind === undefined || body.length < bytes[at + 1]) {
      continue;
    }
    const view = new DataView(body.buffer);
    let place = 0;
    found[kind.name] = {};
    for (const part of kind.fields) {
      const end = place + sizeOf(part.type) * part.count;
      found[kind.name][part.name] = end <= body.length ? (valueOf(part, view, place) ?? null) : null;
      place = end;
    }
  }
  return found;
}

/** Those of one probe; `records` is null while those in force are not known. */
export class Params {
  constructor() {
    this.digest = NaN; // of those in force
    /** @type {Map<number, Records>} those that were heard, by digest */
    this._known = new Map([[0, {}]]);
    /** @type {Map<string, string[]>} */
    this._parts = new Map();
  }

  get records() {
    return this._known.get(this.digest) ?? null;
  }

  /** @param {Record<string, any>} fields of a message `params` */
  add({ set_digest: digest, set_length: length, part_offset: at, part }) {
    const key = `${digest} ${length}`;
    const parts = this._parts.get(key) ?? [];
    parts[at / PART] = part;
    this._parts = new Map([[key, parts]]);
    const digits = Array.from(parts, (each) => each ?? "").join("").slice(0, 2 * length);
    const bytes = Uint8Array.from(digits.match(/../g) ?? [], (pair) => parseInt(pair, 16));
    if (bytes.length === length && crc32(bytes) === digest) {
      this._known.set(digest, recordsOf(bytes));
    }
  }

  get isMagOff() {
    return this.records?.mag?.matrix?.every((/** @type {number} */ each) => each === 0) ?? false;
  }

  /**
   * Counts of a sensor in the unit of its hello's lsb.
   * @param {keyof typeof SENSORS} sensor
   * @param {number[] | null} counts
   * @param {number} lsb
   */
  measure(sensor, counts, lsb) {
    if (counts === null || this.records === null || (sensor === "mag" && this.isMagOff)) {
      return null;
    }
    const { bias = [0, 0, 0], matrix = [1, 0, 0, 0, 1, 0, 0, 0, 1] } = this.records[sensor] ?? {};
    const [x, y, z] = counts.map((count, axis) => count - bias[axis]);
    return [0, 3, 6].map((row) => lsb * (matrix[row] * x + matrix[row + 1] * y + matrix[row + 2] * z));
  }

  /** As they are in a status. */
  get summary() {
    const sensors = Object.entries(SENSORS).map(([name, key]) => {
      const { sigma = null, bias, matrix } = this.records?.[name] ?? {};
      const isField = sigma === null && String([bias, matrix]) === "0,0,0,1,0,0,0,1,0,0,0,1";
      const isCalibrated = matrix !== undefined && !isField && !(name === "mag" && this.isMagOff);
      return [name, { is_calibrated: isCalibrated, [key]: sigma }];
    });
    return {
      digest: Number.isNaN(this.digest) ? null : this.digest.toString(16).padStart(8, "0"),
      is_known: this.records !== null,
      flags: this.isMagOff ? ["mag_off"] : [],
      options: this.records?.options,
      ...Object.fromEntries(sensors),
    };
  }
}
