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
    /** @type {{ opened: UsbPort, marks: MarkBook }[]} */
    this._all = [];
    this._ticks = 0;
    this._serial = /** @type {any} */ (navigator).serial;
    this._serial?.addEventListener("connect", (/** @type {Event} */ { target }) => {
      this._all.find(({ opened }) => opened.port === target)?.opened.open().catch(() => {});
    });
    setInterval(() => this._tick(), TICK_MS);
  }

  /** @override */
  open() {
    this._become("open");
    this._emit({ type: "page", imud: document.documentElement.dataset.version ?? "", role: "this page alone", reads: READS, commands: true });
  }

  /** Ports on which no probe was heard yet, in words. */
  get unheard() {
    const silent = this._all.filter(({ opened }) => !opened.reader.probe);
    return silent.map(({ opened }) => `${opened.name} at ${opened.baud} baud`).join(", ");
  }

  /** @override */
  async connect() {
    if (this._serial === undefined) {
      throw new Error("this browser can't read USB: use Chrome, Chromium or Edge on a computer");
    }
    const port = await this._serial.requestPort().catch((/** @type {Error} */ error) => {
      if (error.name !== "NotFoundError") {
        throw error; // else the user has chosen none
      }
    });
    if (!port) {
      return;
    }
    const known = this._all.find(({ opened }) => opened.port === port);
    const opened = known?.opened ?? new UsbPort(port, (line) => this._emit(line));
    if (!opened.isOpen) {
      await opened.open();
    }
    if (known === undefined) {
      this._all.push({ opened, marks: new MarkBook() });
    }
  }

  _tick() {
    this._ticks += 1;
    for (const { opened } of this._all) {
      const { reader, isOpen, name } = opened;
      if (reader.probe) {
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
    const found = this._all.find(({ opened }) => opened.reader.probe === message.probe);
    if (message.do !== "ask" || found === undefined) {
      return super._request(message);
    }
    const { opened, marks } = found;
    const { probe, command, parameters } = message;
    if (command === "aim") {
      return { value: null }; // the page judges it by the pose itself
    }
    if (command === "capture") {
      return { value: { q: opened.reader.pose.q } };
    }
    if (command === "mark") {
      const value = marks.take(opened.reader, parameters, Date.now());
      this._emit({ type: "marks", probe, marks: marks.all });
      return { value };
    }
    return command in COMMANDS ? { value: await opened.command(command, parameters) } : super._request(message);
  }
}
