// SPDX-License-Identifier: MIT
// @ts-check
// A serial port that the user chose in the browser: finds the baud rate, reads, and
// sends commands until the probe replies.

import { commandFrame } from "./frames.js";
import { Reader } from "./reader.js";
import { COMMANDS } from "./wire.js";

/** @typedef {import("./wire.js").Argument} Argument */

const BAUDS = [500_000, 921_600]; // of a Nano and an F405; a Pico takes any
const HELLO_MS = 4000; // a Nano begins again when its port is opened
const REPLY_MS = 1000;
const TRIES = 3;
const ROUNDS = 2; // of all baud rates: each opening restarts an Arduino that is no probe
const GONE = "the probe is unplugged; plug it in";
const BUFFER = 1 << 16; // bytes: a second

/**
 * The number that a probe gets; NaN: a wrong parameter.
 * @param {Argument} argument
 * @param {string | undefined} text
 */
function numberOf({ type, choices, isOptional }, text) {
  if (text === undefined) {
    return isOptional ? 0 : NaN;
  }
  if (type === "integer") {
    return /^-?\d{1,9}$/.test(text) ? Number(text) : NaN;
  }
  const words = type === "list" ? text.split(",") : [text];
  const numbers = words.map((word) => choices[word] ?? NaN);
  return type === "list" ? numbers.reduce((sum, bit) => sum + 2 ** bit, 0) : numbers[0];
}

/** One port, and the probe that is read there. */
export class UsbPort {
  /**
   * @param {any} port of WebSerial, whose types TypeScript does not have
   * @param {(line: import("../link.js").Line) => void} say
   */
  constructor(port, say) {
    this.port = port;
    this.reader = new Reader(say);
    this.isOpen = false;
    this._tries = 0;
    this._token = Math.floor(Math.random() * 0xffff); // a probe leaves out the last one
    /** @type {Map<number, (reply: Record<string, any>) => void>} */
    this._waiting = new Map();
    /** @type {Promise<unknown>} */
    this._before = Promise.resolve();
    this.reader.onReply = (reply) => this._waiting.get(reply.replied_token)?.(reply);
  }

  get baud() {
    return BAUDS[this._tries % BAUDS.length];
  }

  /** Whether no baud rate had a probe. */
  get isGivenUp() {
    return this._tries > 0 && this._tries % (ROUNDS * BAUDS.length) === 0;
  }

  get name() {
    const { usbVendorId: vendor, usbProductId: product } = this.port.getInfo();
    const digits = [vendor, product].map((each) => each?.toString(16).padStart(4, "0"));
    return vendor === undefined ? "serial port" : `USB ${digits.join(":")}`;
  }

  /** Opens it; what comes is read until it is unplugged. */
  async open() {
    await this.port.open({ baudRate: this.baud, bufferSize: BUFFER });
    this.isOpen = true;
    this._read();
  }

  async _read() {
    const { reader, port } = this;
    let isWrong = false; // the baud rate
    /** @type {any} */
    let stream;
    // Of all streams: at a wrong baud rate one after the other ends by damaged bytes.
    const timer = setTimeout(() => {
      isWrong = reader.hello === null;
      if (isWrong) {
        stream.cancel().catch(() => {});
      }
    }, HELLO_MS);
    while (port.readable && !isWrong) {
      stream = port.readable.getReader();
      try {
        for (;;) {
          const { value, done } = await stream.read();
          if (done) {
            break;
          }
          reader.receive(value, Date.now());
        }
      } catch {
        // A break or a damaged byte: the port goes on with another stream.
      }
      stream.releaseLock();
    }
    clearTimeout(timer);
    this.isOpen = false;
    await port.close().catch(() => {});
    if (isWrong) {
      this._tries += 1;
      if (!this.isGivenUp) {
        await this.open().catch(() => {});
      }
    }
  }

  /**
   * Has the probe carry out a command, and returns the value of its reply.
   * @param {string} name
   * @param {Record<string, string>} parameters
   * @returns {Promise<any>}
   */
  command(name, parameters) {
    // One at a time: a probe remembers the last token alone.
    const done = this._before.then(() => this._command(name, parameters));
    this._before = done.catch(() => {});
    return done;
  }

  /**
   * @param {string} name
   * @param {Record<string, string>} parameters
   */
  async _command(name, parameters) {
    const { number, usage, arguments: wanted } = COMMANDS[name];
    const values = wanted.map((each) => numberOf(each, parameters[each.name]));
    if (values.some(Number.isNaN)) {
      throw new Error(usage);
    }
    this._token = (this._token % 0xffff) + 1;
    const token = this._token;
    const frame = commandFrame(number, token, [values[0] ?? 0, values[1] ?? 0]);
    for (let tries = 0; tries < TRIES; tries++) {
      const { writable } = this.port;
      if (!this.isOpen || !writable) {
        throw new Error(GONE);
      }
      const reply = await Promise.race([
        new Promise((resolve, reject) => {
          this._waiting.set(token, resolve);
          const writer = writable.locked ? null : writable.getWriter(); // the try before
          const written = writer?.write(frame).catch(() => reject(new Error(GONE)));
          written?.finally(() => writer.releaseLock());
        }),
        new Promise((resolve) => setTimeout(resolve, REPLY_MS)),
      ]);
      this._waiting.delete(token);
      if (reply && reply.result !== "ok") {
        throw new Error(`the probe refused ${name}: ${reply.result.replaceAll("_", " ")}`);
      }
      if (reply) {
        return reply.value;
      }
    }
    throw new Error(`the probe did not answer ${name}, ${TRIES} times; check its cable`);
  }
}
