// SPDX-License-Identifier: MIT
// @ts-check
// The page's data of the probes: the last message of each kind, and its arrival.

import { Marks } from "./marks.js";
import { Strokes } from "./strokes.js";

/** @typedef {import("./link.js").Line} Line */

/** @typedef {import("./published.js").SinceOrigin} Since */
/** @typedef {import("./published.js").PoseFields} Pose */
/** @typedef {import("./published.js").Aim} Aim */

/** @typedef {{ state: Line, heardMs: number }} Body a limb: its last state, and when */

// A value is stale when the next one is late: after five of its periods, and at least
// after this long; at most after the second number.
const STALE_MIN_MS = 200;
const STALE_MAX_MS = 450;

/**
 * The errors of a pose: those since its origin where it has one, else those in the world.
 * @param {Pose} pose
 */
export function errorsOf(pose) {
  const since = pose.since_origin ?? null;
  return since !== null && since.void === null ? since : pose;
}

/** One probe, as far as the page has heard. */
export class Probe {
  /** @param {string} name */
  constructor(name) {
    this.name = name;
    /** @type {Pose | null} */
    this.pose = null;
    this.poseMs = -Infinity;
    this._periodMs = 100;
    /** @type {Aim | null} */
    this.aim = null;
    /** @type {Line | null} */
    this.status = null;
    this.statusMs = -Infinity;
    /** @type {Line | null} */
    this.params = null;
    /** @type {Line | null} */
    this.calibration = null;
    /** @type {Line | null} */
    this.update = null; // of its firmware
    /** @type {Line | null} */
    this.event = null;
  }

  /** @param {number} nowMs */
  isStale(nowMs) {
    const patience = Math.max(STALE_MIN_MS, 5 * this._periodMs);
    return nowMs - this.poseMs > Math.min(patience, STALE_MAX_MS);
  }

  /** Its name; one that nobody has named by its board and the last digits of its id. */
  get label() {
    const board = this.status?.hello?.board ?? "probe";
    return /^[0-9a-f]{16}$/.test(this.name) ? `${board}-${this.name.slice(-4)}` : this.name;
  }

  /**
   * What the probe does, in the daemon's words.
   * @param {number} nowMs
   */
  state(nowMs) {
    if (this.status === null) {
      return "unknown";
    }
    return nowMs - this.statusMs < 3000 ? String(this.status.state) : "unheard";
  }

  /**
   * @param {Line} line
   * @param {number} nowMs
   */
  take(line, nowMs) {
    if (line.type === "pose") {
      const pose = /** @type {Pose} */ (/** @type {unknown} */ (line));
      const gapMs = nowMs - this.poseMs;
      if (gapMs < 1000) {
        this._periodMs += (gapMs - this._periodMs) / 16;
      }
      this.pose = pose;
      this.poseMs = nowMs;
    } else if (line.type === "aim") {
      this.aim = /** @type {Aim} */ (/** @type {unknown} */ (line));
    } else if (line.type === "status") {
      this.status = line;
      this.statusMs = nowMs;
    } else if (line.type === "params") {
      this.params = line;
    } else if (line.type === "calibration") {
      this.calibration = line;
    } else if (line.type === "update") {
      this.update = line;
    } else if (line.type === "event") {
      this.event = line;
    }
  }
}

/**
 * All probes by name. Emits "probe" with each line about one, "body" with each state of
 * a limb, "renamed" if the selected one was, "list", and "reset" when a log takes the place of what is live, or the other way round.
 */
export class Model extends EventTarget {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    super();
    this.link = link;
    /** @type {Map<string, Probe>} */
    this.probes = new Map();
    /** @type {Line} */
    this.page = { type: "page", role: "", reads: [], commands: false, imud: "" };
    this.selected = "";
    /** @type {Line | null} */
    this.played = null; // where the log is that is played
    this.strokes = new Strokes(this);
    this.marks = new Marks(this);
    /** @type {Map<string, string>} */
    this._labels = new Map();
    /** @type {Map<string, Body>} */
    this.bodies = new Map();
    link.addEventListener("line", (event) => {
      this._take(/** @type {CustomEvent<Line>} */ (event).detail);
    });
  }

  /** @returns {Probe | undefined} */
  get probe() {
    return this.probes.get(this.selected);
  }

  get names() {
    return [...this.probes.keys()].sort();
  }

  /**
   * What to call a probe: its label, unless two would be called so.
   * @param {string} name
   */
  labelOf(name) {
    return this._labels.get(name) ?? name;
  }

  /**
   * A text with what to call probes in the place of their ids.
   * @param {string} text
   */
  named(text) {
    return text.replace(/\b[0-9a-f]{16}\b/g, (id) => {
      const probe = [...this.probes.values()].find(({ status }) => status?.probe_id === id);
      return probe ? this.labelOf(probe.name) : id;
    });
  }

  /** Other probes are there, or are called otherwise. */
  _changed() {
    const all = [...this.probes.values()].map((probe) => ({ name: probe.name, label: probe.label }));
    const isTwice = (/** @type {string} */ label) => all.filter((one) => one.label === label).length > 1;
    this._labels = new Map(all.map(({ name, label }) => [name, isTwice(label) ? name : label]));
    this.dispatchEvent(new CustomEvent("list"));
  }

  get mayCommand() {
    return Boolean(this.page.commands) && !this.page.playing && this.link.state === "open";
  }

  /** @param {string} topic */
  mayRead(topic) {
    return this.page.reads.includes(topic);
  }

  /** @param {string} name */
  select(name) {
    if (name !== this.selected) {
      this.selected = name;
      this.dispatchEvent(new CustomEvent("list"));
    }
  }

  /**
   * A probe that says its id by another name than before was renamed: the one that is
   * selected stays so.
   * @param {Line} status its first by that name
   */
  _rename(status) {
    for (const [name, { status: last }] of this.probes) {
      if (name !== status.probe && last !== null && last.probe_id === status.probe_id) {
        this.probes.delete(name);
        if (name === this.selected) {
          this.selected = status.probe;
          const detail = { label: this.labelOf(name), to: status.probe };
          this.dispatchEvent(new CustomEvent("renamed", { detail }));
        }
      }
    }
  }

  /** @param {Line} line */
  _take(line) {
    if (line.type === "page") {
      if ((line.playing ?? null) !== (this.page.playing ?? null)) {
        this.probes.clear();
        this.bodies.clear();
        this.played = null;
        this.dispatchEvent(new CustomEvent("reset"));
      }
      this.page = line;
      this.dispatchEvent(new CustomEvent("list"));
    } else if (line.type === "played") {
      this.played = line;
    } else if (line.type === "body") {
      this.bodies.set(line.body, { state: line, heardMs: performance.now() });
      this.dispatchEvent(new CustomEvent("body", { detail: line }));
    } else if (typeof line.probe === "string") {
      let probe = this.probes.get(line.probe);
      if (probe === undefined) {
        probe = new Probe(line.probe);
        this.probes.set(line.probe, probe);
        if (!this.probes.has(this.selected)) {
          this.selected = line.probe;
        }
        this._changed();
      }
      const isFirst = line.type === "status" && probe.status === null;
      probe.take(line, performance.now());
      if (isFirst) {
        if (line.probe_id) {
          this._rename(line);
        }
        this._changed(); // its label is known now
      }
      this.dispatchEvent(new CustomEvent("probe", { detail: line }));
    }
  }
}
