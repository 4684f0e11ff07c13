// SPDX-License-Identifier: MIT
// @ts-check
// Bytes of a port to messages and back, as protocol/PROTOCOL.md has them.

import { FINGERPRINT, HELLO_SEED, MESSAGES, SEED } from "./wire.js";

/** @typedef {import("./wire.js").Field} Field */
/** @typedef {{ name: string, sequence: number, time_us: number, fields: Record<string, any> }} Message */

const HEADER = 9; // id, sequence, time
const RAW_MAX = 1 + 120 + 2; // of a frame: a code, content, CRC
const [HELLO, COMMAND] = ["hello", "command"].map((name) => {
  return Number(Object.keys(MESSAGES).find((id) => MESSAGES[Number(id)].name === name));
});
const UNIT_FIELDS = ["q", "normal"];
const NORM_TOLERANCE = 1e-3;

/**
 * @param {number} crc it begins with
 * @param {Iterable<number>} bytes
 */
function crcOf(crc, bytes) {
  for (const byte of bytes) {
    crc ^= byte << 8;
    for (let bit = 0; bit < 8; bit++) {
      crc = (crc << 1) ^ (crc & 0x8000 ? 0x1021 : 0);
    }
    crc &= 0xffff;
  }
  return crc;
}

/**
 * The content of a frame without its delimiter; null: it is damaged.
 * @param {number[]} raw
 */
function contentOf(raw) {
  /** @type {number[]} */
  const bytes = [];
  for (let at = 0; at < raw.length; at += raw[at]) {
    if (at + raw[at] > raw.length) {
      return null;
    }
    bytes.push(...(at > 0 ? [0] : []), ...raw.slice(at + 1, at + raw[at]));
  }
  const [low, high] = bytes.splice(-2);
  const crc = crcOf(bytes[0] === HELLO ? HELLO_SEED : SEED, bytes);
  return bytes.length > 0 && crc === low + 256 * high ? Uint8Array.from(bytes) : null;
}

/** Turns bytes into the contents of frames, whatever the chunks they arrive in. */
export class FrameDecoder {
  constructor() {
    /** @type {number[]} */
    this._raw = [];
  }

  /**
   * @param {Uint8Array} data
   * @returns {(Uint8Array | null)[]} null: a damaged frame
   */
  feed(data) {
    const found = [];
    for (const byte of data) {
      if (byte !== 0) {
        this._raw.push(byte);
        this._raw.length = Math.min(this._raw.length, RAW_MAX + 1);
      } else if (this._raw.length > 0) {
        found.push(this._raw.length > RAW_MAX ? null : contentOf(this._raw));
        this._raw = [];
      }
    }
    return found;
  }
}

/**
 * How many bytes a value of that type has.
 * @param {string} type
 */
export function sizeOf(type) {
  return Number(/\d+$/.exec(type) ?? 8) / 8;
}

/**
 * A field's value; undefined: one that the schema excludes.
 * @param {Field} field
 * @param {DataView} view
 * @param {number} at
 */
export function valueOf(field, view, at) {
  const { type, count, null: none, names, bits } = field;
  const bytes = new Uint8Array(view.buffer, view.byteOffset + at, count);
  if (type === "bytes") {
    return [...bytes].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  }
  if (type === "text") {
    const text = String.fromCharCode(...bytes).replace(/\0+$/, "");
    return /^[ -~]*$/.test(text) ? text : undefined;
  }
  const size = sizeOf(type);
  const read = `get${type[0] === "u" ? "Uint" : "Int"}${8 * size}`;
  const numbers = Array.from({ length: count }, (_, index) => {
    return /** @type {any} */ (view)[read](at + size * index, true);
  });
  if (names) {
    return names[numbers[0]];
  }
  if (bits) {
    const known = bits.reduce((sum, [bit]) => sum + bit, 0);
    return numbers[0] & ~known ? undefined : bits.filter(([bit]) => numbers[0] & bit).map(([, name]) => name);
  }
  const nulls = numbers.filter((number) => number === none).length;
  if (nulls > 0) {
    return nulls === count ? null : undefined;
  }
  const { divide, times } = field;
  const values = numbers.map((number) => (divide ? number / divide : times ? number * times : number));
  if (UNIT_FIELDS.includes(field.name) && Math.abs(Math.hypot(...values) - 1) > NORM_TOLERANCE) {
    return undefined;
  }
  return count === 1 ? values[0] : values;
}

/**
 * The message; null: it is none of our schema, nor a hello of another one.
 * @param {Uint8Array} content
 * @returns {Message | null}
 */
export function decode(content) {
  const kind = MESSAGES[content[0]];
  if (kind === undefined || kind.name === "command" || content.length < HEADER) {
    return null;
  }
  const view = new DataView(content.buffer, content.byteOffset, content.length);
  /** @type {Record<string, any>} */
  const fields = {};
  let at = HEADER;
  let isGood = true;
  for (const field of kind.fields) {
    const end = at + 1 + sizeOf(field.type) * field.count;
    if (content[at] !== field.tag || end > content.length) {
      isGood = false;
      break;
    }
    fields[field.name] = valueOf(field, view, at + 1);
    isGood &&= fields[field.name] !== undefined;
    at = end;
  }
  const isOther = content[0] === HELLO && fields.probe_id && fields.schema_fingerprint !== FINGERPRINT;
  const message = { name: kind.name, sequence: view.getUint32(1, true), time_us: view.getUint32(5, true), fields };
  return (isGood && at === content.length) || isOther ? message : null;
}

/**
 * The frame of a command, behind a delimiter that ends what noise may have begun.
 * @param {number} number
 * @param {number} token
 * @param {number[]} values its two arguments
 */
export function commandFrame(number, token, values) {
  const { fields } = MESSAGES[COMMAND];
  const content = new Uint8Array(HEADER + fields.reduce((sum, { type, count }) => sum + 1 + sizeOf(type) * count, 0));
  const view = new DataView(content.buffer);
  view.setUint8(0, COMMAND);
  view.setUint32(1, token, true);
  let at = HEADER;
  for (const [index, numbers] of [[number], [token], values].entries()) {
    view.setUint8(at++, fields[index].tag);
    const size = sizeOf(fields[index].type);
    for (const value of numbers) {
      const bytes = Uint8Array.of(value, value >> 8, value >> 16, value >> 24);
      content.set(bytes.subarray(0, size), at);
      at += size;
    }
  }
  const crc = crcOf(SEED, content);
  const bytes = [0, 0];
  let code = 1;
  for (const byte of [...content, crc & 255, crc >> 8]) {
    if (byte === 0) {
      bytes[code] = bytes.length - code;
      code = bytes.length;
    }
    bytes.push(byte);
  }
  bytes[code] = bytes.length - code;
  return Uint8Array.from([...bytes, 0]);
}
