// SPDX-License-Identifier: MIT
// @ts-check
// The end of the link without a daemon: probes at serial ports that the user chose. It
// sends nothing but commands to them, and keeps nothing.

import { Link } from "../link.js";
import { MarkBook } from "./marks.js";
import { UsbPort } from "./port.js";
import { COMMANDS } from "./wire.js";

const TICK_MS = 1000;
const ASK_TICKS = 5; // between two requests for params that are not known
const READS = ["pose", "raw", "status", "params", "event", "stroke", "path", "mark", "marks"];

export class UsbLink extends Link {
  constructor() {
    super();
    /** @type {UsbPort[]} */
    this._all = [];
    /** @type {Record<string, MarkBook>} by probe, which may change its port */
    this._marks = {};
    this._ticks = 0;
    this._serial = /** @type {any} */ (navigator).serial;
    this._serial?.addEventListener("connect", (/** @type {Event} */ { target }) => {
      this._all.find(({ port }) => port === target)?.open().catch(() => {});
    });
    setInterval(() => this._tick(), TICK_MS);
  }

  /** @override */
  open() {
    this._become("open");
    this._emit({ type: "page", imud: document.documentElement.dataset.version ?? "", role: "this page alone", reads: READS, commands: true });
  }

  /** About ports on which no probe was heard yet. */
  get unheard() {
    const silent = this._all.filter(({ reader }) => !reader.probe);
    const open = silent.filter(({ isOpen }) => isOpen);
    const names = open.map(({ name, baud }) => `${name} at ${baud} baud`).join(", ");
    if (names) {
      return `${names} is open, but no probe was heard yet: a Nano needs 2 s. Is it the right port?`;
    }
    const others = silent.filter(({ isGivenUp }) => isGivenUp).map(({ name }) => name);
    return others.length > 0 ? `No probe was heard on ${others.join(", ")}: choose another port, or write firmware into the board.` : "";
  }

  /**
   * Where a probe is; behind a change of its port, the one that is open.
   * @param {string} probe
   */
  _portOf(probe) {
    const all = this._all.filter(({ reader }) => reader.probe === probe);
    return all.find(({ isOpen }) => isOpen) ?? all[0];
  }

  /** @override */
  async connect() {
    if (this._serial === undefined) {
      throw new Error(
        isSecureContext
          ? "this browser can't read USB: use Chrome, Chromium or Edge on a computer"
          : "browsers read USB for a page by HTTPS or from a file: save this page, and open the file",
      );
    }
    const port = await this._serial.requestPort().catch((/** @type {Error} */ error) => {
      if (error.name !== "NotFoundError") {
        throw error; // else the user has chosen none
      }
    });
    if (!port) {
      return;
    }
    const known = this._all.find((each) => each.port === port);
    const opened = known ?? new UsbPort(port, (line) => this._emit(line));
    if (!opened.isOpen) {
      await opened.open().catch(() => {
        throw new Error(`can't open ${opened.name}: end what else uses it (imud run, a serial monitor); on Linux join the group dialout`);
      });
    }
    if (known === undefined) {
      this._all.push(opened);
    }
  }

  _tick() {
    this._ticks += 1;
    for (const opened of this._all) {
      const { reader, isOpen, name } = opened;
      if (reader.probe && this._portOf(reader.probe) === opened) {
        reader.tick(isOpen ? `${name}, ${opened.baud} baud` : null, Date.now());
      }
      const isUnknown = reader.hello !== null && !reader.isOther && reader.params.records === null;
      if (isOpen && isUnknown && this._ticks % ASK_TICKS === 0) {
        opened.command("params_tell", {}).catch(() => {});
      }
    }
  }

  /**
   * @override
   * @param {Record<string, any>} message
   * @returns {Promise<any>}
   */
  async _request(message) {
    const { probe, command, parameters } = message;
    const opened = this._portOf(probe);
    if (message.do !== "ask" || opened === undefined) {
      return super._request(message);
    }
    if (command === "aim") {
      return { value: null }; // the page judges it by the pose itself
    }
    if (command === "capture") {
      return { value: { q: opened.reader.pose.q } };
    }
    if (command === "mark") {
      const marks = (this._marks[probe] ??= new MarkBook());
      const value = marks.take(opened.reader, parameters, Date.now());
      this._emit({ type: "marks", probe, marks: marks.all });
      return { value };
    }
    return command in COMMANDS ? { value: await opened.command(command, parameters) } : super._request(message);
  }
}
