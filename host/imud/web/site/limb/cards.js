// SPDX-License-Identifier: MIT
// @ts-check
// The instruction for aligning the limb, its probes, its angles with their errors, and
// the last events of its gait.

import { make, mark, say } from "../dom.js";
import { decimalsOf, fixed, micros, UNKNOWN } from "../format.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("./recorder.js").GaitEvent} GaitEvent */

const STAGES = [
  ["waiting", "probes"],
  ["standing", "stand still"],
  ["moving", "bend every joint"],
  ["running", "aligned"],
];
const SHOWN = 8; // events

/** How far the alignment is, and which probes are there. */
export class AlignCard {
  /** @param {import("../model.js").Model} model */
  constructor(model) {
    this._model = model;
    this._steps = STAGES.map(([stage, words]) => {
      return make("li", { class: "chip", "data-stage": stage }, words);
    });
    this._says = make("p", { class: "says", "data-part": "says", role: "status" });
    this._still = make("progress", { "aria-label": "Time of standing still", value: 0 });
    this._stillFor = make("span", { class: "value" });
    this._standing = make("div", { class: "row" }, this._still, this._stillFor);
    this._bends = make("p", { class: "value", "data-part": "bends" });
    this._probes = make("ul", { class: "targets", "data-part": "segments" });
    this._remarks = make("p", { class: "muted small" });
    this.element = make(
      "div",
      { class: "card" },
      make("h2", {}, "Alignment"),
      make("ol", { class: "row steps" }, ...this._steps),
      this._says,
      this._standing,
      this._bends,
      this._probes,
      this._remarks,
    );
    this._listed = "";
  }

  /** @param {Line} state */
  show(state) {
    const at = STAGES.findIndex(([stage]) => stage === state.stage);
    this._steps.forEach((step, index) => {
      mark(step, "class", `chip ${index < at || at === 3 ? "good" : index === at ? "warn" : ""}`);
      mark(step, "aria-current", index === at ? "step" : false);
    });
    const by = state.aligned ? `Aligned by ${state.aligned}.` : "";
    say(this._says, this._model.named(state.says ?? by));
    this._guide(state);
    const yet = state.aligned ? [] : ["not aligned yet: no angles and places"];
    say(this._remarks, [...yet, ...state.remarks].join("; "));
    const rows = state.segments.map((/** @type {Line} */ segment) => {
      const words = segment.presence === "ok" ? "there" : segment.presence;
      return [segment.name, this._model.named(segment.probe ?? "no probe"), words, segment.age_us];
    });
    const text = JSON.stringify(rows.map((/** @type {unknown[]} */ row) => row.slice(0, 3)));
    if (text !== this._listed) {
      this._listed = text;
      this._ages = rows.map(() => make("span", { class: "muted value" }));
      const items = rows.map((/** @type {string[]} */ [name, probe, words], /** @type {number} */ i) =>
        make(
          "li",
          { "data-segment": name },
          make("span", {}, make("b", {}, name), ` ${probe}`),
          make(
            "span",
            { class: "row" },
            this._ages?.[i] ?? null,
            make("span", { class: `chip ${words === "there" ? "good" : "bad"}` }, words),
          ),
        ),
      );
      this._probes.replaceChildren(...items);
    }
    rows.forEach((/** @type {any[]} */ row, /** @type {number} */ index) => {
      const age = this._ages?.[index];
      if (age) {
        say(age, row[3] === null ? "" : micros(row[3]));
      }
    });
  }

  /** @param {Line} state how far standing and moving are */
  _guide({ stage, still_s, still_of_s, joints }) {
    this._standing.hidden = !still_of_s;
    if (still_of_s) {
      const stoodS = Math.min(still_s, still_of_s);
      this._still.max = still_of_s;
      this._still.value = stoodS;
      say(this._stillFor, `${fixed(stoodS, 1)} of ${still_of_s} s`);
    }
    this._bends.hidden = stage !== "moving";
    const counts = joints.map((/** @type {Line} */ { kind, bends }) => `${kind} ${bends ?? 0}`);
    say(this._bends, `bends: ${counts.join(", ")}`);
  }
}

/** The angles of all joints. */
export class AnglesCard {
  constructor() {
    this._rows = make("tbody", {});
    this.element = make(
      "div",
      { class: "card numbers" },
      make("h2", {}, "Joint angles"),
      make("table", { class: "angles" }, this._rows),
    );
    this._shape = "";
    /** @type {HTMLElement[]} */
    this._cells = [];
  }

  /**
   * @param {Line} state
   * @param {boolean} isStale
   */
  show(state, isStale) {
    mark(this.element, "data-stale", isStale);
    const rows = state.joints.flatMap((/** @type {Line} */ { kind, child, angles_deg, sigmas_deg }) => {
      const names = Object.keys(angles_deg ?? { flexion: 0 });
      return names.map((name) => {
        return { kind, child, name, angle: angles_deg?.[name], error: sigmas_deg?.[name] };
      });
    });
    const shape = rows.map((/** @type {any} */ { child, name }) => `${child} ${name}`).join();
    if (shape !== this._shape) {
      this._shape = shape;
      this._cells = rows.map((/** @type {any} */ { child, name }) => {
        return make("td", { class: "value", "data-angle": `${child} ${name}` });
      });
      const lines = rows.map((/** @type {any} */ { kind, name }, /** @type {number} */ index) =>
        make("tr", {}, make("th", { scope: "row" }, `${kind} ${name}`), this._cells[index]),
      );
      this._rows.replaceChildren(...lines);
    }
    rows.forEach((/** @type {any} */ { angle, error }, /** @type {number} */ index) => {
      const sure = error === undefined || error === null ? "" : ` ±${fixed(error, decimalsOf(error))}`;
      const why = state.aligned ? "missing" : "not aligned yet";
      const text = angle === undefined ? `${UNKNOWN}, ${why}` : `${fixed(angle, decimalsOf(error), 6)}°${sure}`;
      say(this._cells[index], text);
    });
  }
}

/** When the foot came down and left the ground. */
export class GaitCard {
  constructor() {
    this._rows = make("tbody", {});
    this.element = make(
      "div",
      { class: "card", hidden: true },
      make("h2", {}, "Gait"),
      make(
        "table",
        { class: "angles" },
        make(
          "thead",
          {},
          make("tr", {}, ...["time", "event", "stride"].map((text) => make("th", {}, text))),
        ),
        this._rows,
      ),
    );
    this._count = -1;
  }

  /** @param {GaitEvent[]} events */
  show(events) {
    this.element.hidden = events.length === 0;
    const last = events.at(-1)?.t_ns ?? 0;
    if (last === this._count) {
      return;
    }
    this._count = last;
    const rows = events.slice(-SHOWN).reverse().map(({ t_ns, what, segment, stride_m }) => {
      const time = new Date(t_ns / 1e6);
      const clock = `${time.toTimeString().slice(0, 8)}.${String(time.getMilliseconds()).padStart(3, "0")}`;
      return make(
        "tr",
        {},
        make("td", { class: "value" }, clock),
        make("td", {}, `${what}, ${segment}`),
        make("td", { class: "value" }, stride_m === null ? "" : `${fixed(stride_m, 2)} m`),
      );
    });
    this._rows.replaceChildren(...rows);
  }
}
