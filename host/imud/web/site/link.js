// SPDX-License-Identifier: MIT
// @ts-check
// The connection to the server. It heals itself; an event tells each change.

/** @typedef {Record<string, any> & { type: string }} Line */
/** @typedef {"connecting" | "open" | "silent" | "login" | "lost"} LinkState */
/** @typedef {{ side: string, probes: Record<string, string> }} LimbSetup the ids of probes by segment */
/** @typedef {{ resolve: (answer: any) => void, reject: (error: Error) => void }} Waiting */

// The server says something every 0.2 s; after a second without, it is silent, and after
// three the page connects again. A busy machine may take longer to connect.
const SILENT_MS = 1000;
const DEAD_MS = 3000;
const CONNECT_MS = 10000;
const RETRY_MS = [100, 250, 500, 1000];
const SEEN_EVERY = 4;
const HIDDEN_HZ = 5;

/** Emits "line" for each line but heads, and "state". */
export class Link extends EventTarget {
  constructor() {
    super();
    /** @type {LinkState} */
    this.state = "connecting";
    this.leftOut = 0;
    this.received = 0;
    this.bytes = 0;
    /** @type {number | null} */
    this._ahead = null;
    /** @type {WebSocket | null} */
    this._socket = null;
    this._heardMs = performance.now();
    this._number = 0;
    this._seen = 0;
    this._tries = 0;
    this._asked = 0;
    /** @type {Map<number, Waiting>} */
    this._waiting = new Map();
    /** @type {[string, string][]} */
    this._every = [];
    this._rateHz = 60;
    this._probe = "";
    this._decoder = new TextDecoder();
    this._credentials = takeToken() ?? storedLogin();
    setInterval(() => this._check(), 100);
    document.addEventListener("visibilitychange", () => this._tellWatch());
  }

  /** How far the server's clock is ahead of this one's, ms. */
  get aheadMs() {
    return this._ahead ?? 0;
  }

  open() {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    this._socket = socket;
    this._heardMs = performance.now();
    this._number = this._seen = 0;
    socket.onopen = () => {
      this._heardMs = performance.now();
      if (this._credentials) {
        this._send({ do: "login", ...this._credentials });
      }
      this._tellWatch();
    };
    socket.onmessage = (event) => this._take(event.data);
    socket.onclose = () => this._lost(socket);
  }

  /**
   * Asks for every payload of these topics, and for updates at a rate; poses of probes
   * that are not looked at come less often.
   * @param {[string, string][]} every
   * @param {number} rateHz
   * @param {string} probe
   */
  watch(every, rateHz, probe) {
    const isSame = rateHz === this._rateHz && probe === this._probe;
    if (!isSame || String(every) !== String(this._every)) {
      this._every = every;
      this._rateHz = rateHz;
      this._probe = probe;
      this._tellWatch();
    }
  }

  /** Tells the server that all that came is drawn. */
  drawn() {
    if (this._number - this._seen >= SEEN_EVERY) {
      this._seen = this._number;
      this._send({ do: "seen", n: this._number });
    }
  }

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
  live() {
    this._send({ do: "live" });
  }

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
   * @param {object} message
   * @returns {Promise<any>}
   */
  _request(message) {
    const id = ++this._asked;
    this._send({ ...message, id });
    return new Promise((resolve, reject) => this._waiting.set(id, { resolve, reject }));
  }

  /**
   * @param {string} user
   * @param {string} secret
   */
  logIn(user, secret) {
    this._credentials = { user, secret };
    sessionStorage.setItem("imud.login", JSON.stringify(this._credentials));
    this._send({ do: "login", ...this._credentials });
  }

  /** @param {object} message */
  _send(message) {
    if (this._socket?.readyState === WebSocket.OPEN) {
      this._socket.send(JSON.stringify(message));
    }
  }

  _tellWatch() {
    const rate = document.hidden ? HIDDEN_HZ : this._rateHz;
    const probe = this._probe || null;
    this._send({ do: "watch", every: this._every, rate_hz: rate, probe });
    this._heardMs = performance.now();
  }

  /** @param {ArrayBuffer} data */
  _take(data) {
    this._heardMs = performance.now();
    this.bytes += data.byteLength;
    for (const text of this._decoder.decode(data).split("\n")) {
      try {
        this._line(JSON.parse(text));
      } catch (error) {
        if (!(error instanceof SyntaxError)) {
          throw error;
        }
      }
    }
    if (document.hidden) {
      this.drawn();
    }
  }

  /** @param {Line} line */
  _line(line) {
    if (line.type === "head") {
      this._number = line.n;
      this.leftOut = line.left_out;
      this.received += 1;
      // The least of what a clock's difference and the way here add up to.
      const ahead = line.t_ms - Date.now();
      this._ahead = this._ahead === null ? ahead : Math.max(ahead, this._ahead - 0.01);
      if (this.state === "silent") {
        this._become("open");
      }
    } else if (line.type === "answer") {
      const waiting = this._waiting.get(line.id);
      this._waiting.delete(line.id);
      if (line.error) {
        waiting?.reject(new Error(line.error));
      } else {
        waiting?.resolve(line.answer);
      }
    } else {
      if (line.type === "page") {
        this._tries = 0;
        this._become(line.reads.length ? "open" : "login");
      } else if (line.type === "login") {
        this._credentials = null;
        sessionStorage.removeItem("imud.login");
        this._become("login");
      }
      this.dispatchEvent(new CustomEvent("line", { detail: line }));
    }
  }

  _check() {
    const silentMs = performance.now() - this._heardMs;
    if (document.hidden || this._socket === null) {
      return;
    }
    const socket = this._socket;
    const isConnecting = socket.readyState === WebSocket.CONNECTING;
    if (silentMs > (isConnecting ? CONNECT_MS : DEAD_MS)) {
      socket.close();
      this._lost(socket);
    } else if (silentMs > SILENT_MS && this.state === "open") {
      this._become("silent");
    }
  }

  /** @param {WebSocket} socket */
  _lost(socket) {
    if (socket !== this._socket) {
      return;
    }
    this._socket = null;
    for (const waiting of this._waiting.values()) {
      waiting.reject(new Error("the connection was lost before the answer came"));
    }
    this._waiting.clear();
    this._become("lost");
    const wait = RETRY_MS[Math.min(this._tries++, RETRY_MS.length - 1)];
    setTimeout(() => this.open(), wait);
  }

  /** @param {LinkState} state */
  _become(state) {
    if (state !== this.state) {
      this.state = state;
      this.dispatchEvent(new CustomEvent("state"));
    }
  }
}

/** The token that `imud view` puts behind the address, which is then removed there. */
function takeToken() {
  const match = /^#token=([\w-]+)$/.exec(location.hash);
  if (!match) {
    return null;
  }
  history.replaceState(null, "", location.pathname);
  const login = { user: "", secret: match[1] };
  sessionStorage.setItem("imud.login", JSON.stringify(login));
  return login;
}

/** @returns {{ user: string, secret: string } | null} */
function storedLogin() {
  const text = sessionStorage.getItem("imud.login");
  return text === null ? null : JSON.parse(text);
}
