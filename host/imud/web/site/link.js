// SPDX-License-Identifier: MIT
// @ts-check
// The seam between the page and its data: the daemon (daemon.js), or a probe that this
// page reads from USB by itself (usb/link.js). An event tells each change.

/** @typedef {Record<string, any> & { type: string }} Line */
/** @typedef {"connecting" | "open" | "silent" | "login" | "lost"} LinkState */
/** @typedef {{ side: string, probes: Record<string, string> }} LimbSetup the ids of probes by segment */

/** Whether this is the page of `imud view --to`, which has no daemon. */
export const isAlone = document.documentElement.dataset.daemon === "none";

/** Emits "line" for each line but heads, and "state". */
export class Link extends EventTarget {
  constructor() {
    super();
    /** @type {LinkState} */
    this.state = "connecting";
    this.leftOut = 0;
    this.received = 0;
    this.bytes = 0;
  }

  /** How far the clock of its times is ahead of this one's, ms. */
  get aheadMs() {
    return 0;
  }

  open() {}

  /**
   * Asks for every payload of these topics, and for updates at a rate; poses of probes
   * that are not looked at come less often.
   * @param {[string, string][]} _every
   * @param {number} _rateHz
   * @param {string} _probe
   */
  watch(_every, _rateHz, _probe) {}

  /** Tells that all that came is drawn. */
  drawn() {}

  /** Has the user choose a port with a probe. */
  async connect() {}

  /**
   * @param {string} _user
   * @param {string} _secret
   */
  logIn(_user, _secret) {}

  /**
   * Sends a command to a probe; rejects with the daemon's words if it fails.
   * @param {string} probe
   * @param {string} command
   * @param {Record<string, string>} [parameters]
   * @returns {Promise<any>}
   */
  ask(probe, command, parameters = {}) {
    if (this.state !== "open") {
      return Promise.reject(new Error("not connected"));
    }
    return this._request({ do: "ask", probe, command, parameters });
  }

  /**
   * Begins a calibration of that kind; "end" has it judged, "stop" gives it up.
   * @param {string} probe
   * @param {string} kind
   */
  calibrate(probe, kind) {
    return this._request({ do: "calibrate", probe, kind });
  }

  /**
   * Writes the newest firmware into a probe; lines of the type "update" tell how it does.
   * @param {string} probe
   */
  update(probe) {
    return this._request({ do: "update", probe });
  }

  /** @returns {Promise<{ name: string, bytes: number, changed_ms: number }[]>} */
  logs() {
    return this._request({ do: "logs" });
  }

  /**
   * Has the tables of a log made, in a file that can be read as a log is.
   * @param {string} name
   * @returns {Promise<{ name: string, bytes: number }>}
   */
  tables(name) {
    return this._request({ do: "export", name });
  }

  /** @returns {Promise<{ port: string, kind: string, standing: string, is_opened: boolean, why: string, held_by: string[] }[]>} */
  ports() {
    return this._request({ do: "ports" });
  }

  /**
   * Makes a serial port the daemon's own, or leaves it to others.
   * @param {string} port
   * @param {boolean} ours
   */
  adopt(port, ours) {
    return this._request({ do: "adopt", port, ours });
  }

  /** @param {boolean} on whether a virtual probe should run */
  virtual(on) {
    return this._request({ do: "virtual", on });
  }

  /** @returns {Promise<{ segments: string[], saved: (LimbSetup & { name: string })[] }>} */
  limbs() {
    return this._request({ do: "limbs" });
  }

  /**
   * Keeps a limb, if there is a set-up, and runs it.
   * @param {string | null} name null: ends the one that runs
   * @param {LimbSetup} [setup]
   * @param {boolean} [replace] the saved one of that name
   */
  limb(name, setup, replace) {
    return this._request({ do: "limb", name, setup, replace });
  }

  /**
   * Plays a log instead of live data, at this multiple of real time; 0: paused.
   * @param {string} name
   * @param {number} speed
   * */
  play(name, speed) {
    return this._request({ do: "play", name, speed });
  }

  /**
   * Goes to a time of the log that is played.
   * @param {number} timeMs UTC
   */
  seek(timeMs) {
    return this._request({ do: "seek", t_ms: timeMs });
  }

  /** Ends the log: what is live comes again. */
  live() {}

  /**
   * A part of a log, from that byte on; empty at its end.
   * @param {string} name
   * @param {number} offset
   */
  async read(name, offset) {
    const text = atob(await this._request({ do: "read", name, offset }));
    return Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  }

  /**
   * @param {Record<string, any>} _message
   * @returns {Promise<any>}
   */
  _request(_message) {
    return Promise.reject(new Error("this needs the daemon: imud run"));
  }

  /** @param {Line} line */
  _emit(line) {
    this.dispatchEvent(new CustomEvent("line", { detail: line }));
  }

  /** @param {LinkState} state */
  _become(state) {
    if (state !== this.state) {
      this.state = state;
      this.dispatchEvent(new CustomEvent("state"));
    }
  }
}
