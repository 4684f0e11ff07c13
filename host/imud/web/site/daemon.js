// SPDX-License-Identifier: MIT
// @ts-check
// The connection to the daemon. It heals itself.

import { Link } from "./link.js";

/** @typedef {import("./link.js").Line} Line */
/** @typedef {{ resolve: (answer: any) => void, reject: (error: Error) => void }} Waiting */

// The server says something every 0.2 s; after a second without, it is silent, and after
// three the page connects again. A busy machine may take longer to connect.
const SILENT_MS = 1000;
const DEAD_MS = 3000;
const CONNECT_MS = 10000;
const RETRY_MS = [100, 250, 500, 1000];
const SEEN_EVERY = 4;
const HIDDEN_HZ = 5;

export class DaemonLink extends Link {
  constructor() {
    super();
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

  /** @override */
  get aheadMs() {
    return this._ahead ?? 0;
  }

  /** @override */
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
   * @override
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

  /** @override */
  drawn() {
    if (this._number - this._seen >= SEEN_EVERY) {
      this._seen = this._number;
      this._send({ do: "seen", n: this._number });
    }
  }

  /** @override */
  live() {
    this._send({ do: "live" });
  }

  /**
   * @override
   * @param {object} message
   * @returns {Promise<any>}
   */
  _request(message) {
    const id = ++this._asked;
    this._send({ ...message, id });
    return new Promise((resolve, reject) => this._waiting.set(id, { resolve, reject }));
  }

  /**
   * @override
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
      this._emit(line);
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
