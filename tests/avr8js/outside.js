// SPDX-License-Identifier: MIT
// @ts-check
// What is around the board, at the other end of two pipes: the sensor's model on the
// bus, the button, and the host. test_avr8js.py has the same formats.
import fs from "node:fs";

const STDIN = 0;
const STDOUT = 1;
const REQUEST_BYTES = 10; // kind, argument, time in ns as float64
const REPLY_BYTES = 11; // value, flags, number of bytes that follow, time in ns
const ROOM = 400 * REQUEST_BYTES; // a pipe takes that much at once

export const FLAG_DATA_READY = 1;
export const FLAG_BUTTON = 2; // is down
export const FLAG_END = 4; // the run is over

/**
 * @typedef {object} Reply
 * @property {number} value
 * @property {number} flags
 * @property {number} next_ns the time of the next event
 * @property {Buffer} bytes for the board's UART
 * */

/** The other side has ended, and so does this one. */
export class Gone extends Error {}

export class Outside {
  #requests = Buffer.alloc(ROOM);
  #used = 0;
  #reply = Buffer.alloc(REPLY_BYTES);

  /**
   * Tells what needs no answer.
   * @param {string} kind one character
   * @param {number} argument
   * @param {number} now_ns
   */
  tell(kind, argument, now_ns) {
    if (this.#used === ROOM) {
      this.#flush();
    }
    this.#requests.writeUInt8(kind.charCodeAt(0), this.#used);
    this.#requests.writeUInt8(argument, this.#used + 1);
    this.#requests.writeDoubleLE(now_ns, this.#used + 2);
    this.#used += REQUEST_BYTES;
  }

  /**
   * Tells, and waits for the answer.
   * @param {string} kind one character
   * @param {number} argument
   * @param {number} now_ns
   * @returns {Reply}
   */
  ask(kind, argument, now_ns) {
    this.tell(kind, argument, now_ns);
    this.#flush();
    const reply = this.#read(this.#reply);
    return {
      value: reply.readUInt8(0),
      flags: reply.readUInt8(1),
      next_ns: reply.readDoubleLE(3),
      bytes: this.#read(Buffer.alloc(reply.readUInt8(2))),
    };
  }

  #flush() {
    let sent = 0;
    while (sent < this.#used) {
      sent += fs.writeSync(STDOUT, this.#requests, sent, this.#used - sent);
    }
    this.#used = 0;
  }

  /** @param {Buffer} into */
  #read(into) {
    let got = 0;
    while (got < into.length) {
      const count = fs.readSync(STDIN, into, got, into.length - got, null);
      if (count === 0) {
        throw new Gone();
      }
      got += count;
    }
    return into;
  }
}
