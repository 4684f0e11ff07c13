// SPDX-License-Identifier: MIT
// @ts-check
// Runs the Nano's image in avr8js: node nano.js NODE_MODULES IMAGE.hex. What is around
// the board is at the other end of standard input and output.
import fs from "node:fs";
import { createRequire } from "node:module";
import path from "node:path";

import { Board, Kept } from "./board.js";
import { Gone, Outside } from "./outside.js";

/**
 * Reads Intel HEX into the flash.
 * @param {string} text
 * @param {Uint8Array} flash
 */
function load(text, flash) {
  for (const line of text.trim().split(/\s+/)) {
    const record = Buffer.from(line.slice(1), "hex");
    const [length, high, low, kind] = record;
    const sum = record.reduce((total, byte) => total + byte, 0) & 0xff;
    if (line[0] !== ":" || record.length !== length + 5 || sum !== 0) {
      throw new Error(`no record of Intel HEX: ${line}`);
    }
    if (kind === 0) {
      flash.set(record.subarray(4, 4 + length), high * 0x100 + low);
    }
  }
}

const [modules, image] = process.argv.slice(2);
/** @type {typeof import("avr8js")} */
const avr8js = createRequire(path.join(path.resolve(modules), "_"))("avr8js");
const kept = new Kept(avr8js);
load(fs.readFileSync(image, "ascii"), new Uint8Array(kept.program.buffer));
const outside = new Outside();
try {
  while (new Board(avr8js, outside, kept).run()) {
    // A reset: the next board continues with what is kept.
  }
} catch (error) {
  if (!(error instanceof Gone)) {
    throw error;
  }
}
