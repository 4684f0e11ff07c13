// SPDX-License-Identifier: MIT
// @ts-check
// One probe: the 3D picture, its numbers with their errors, and what can be done to it.

import { keep, kept, make, mark, pictured, save, say } from "../dom.js";
import { fixed, span } from "../format.js";
import { toAngles } from "../rotation.js";
import { Scene } from "../scene/scene.js";
import { Controls } from "./controls.js";
import { convention } from "./convention.js";
import { MarksCard } from "./marks.js";
import { Numbers } from "./numbers.js";
import { concerns, flagWords, showChips, STATES } from "./words.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../model.js").Probe} Probe */

// Numbers change at most this often: faster ones can't be read.
const NUMBERS_MS = 50;
const DESCRIBE_MS = 1000; // a reader that speaks needs longer than a screen
const LEGEND = "sector and cone: two sigma";

/**
 * @param {string} name
 * @param {[string, string][]} choices
 * @param {(value: string) => void} onChange
 */
function choice(name, choices, onChange) {
  const options = choices.map(([value, text]) => make("option", { value }, text));
  const field = make(
    "select",
    { "aria-label": name, onchange: () => onChange(field.value) },
    ...options,
  );
  return field;
}

/**
 * The picture in words.
 * @param {Probe} probe
 * @param {boolean} isStale
 */
function described({ name, pose }, isStale) {
  if (pose === null) {
    return `${name}: no pose yet`;
  }
  const { yaw, pitch, roll } = toAngles(pose.q, convention());
  const angles = `yaw ${fixed(yaw, 0)}, pitch ${fixed(pitch, 0)}, roll ${fixed(roll, 0)} degrees`;
  return `${name}: ${angles}${isStale ? ", old" : ""}`;
}

/** A view of the selected probe. */
export class ProbeView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    /** @type {readonly string[]} */
    this.every = [];
    this._numbersMs = 0;
    this._describedMs = 0;
    this._stage = make("div", { class: "stage" });
    this._state = make("span", { class: "chip", "data-part": "state" });
    this._age = make("span", { class: "chip warn", "data-part": "age", hidden: true });
    this._flags = make("span", { class: "flags", "data-part": "flags" });
    this._concerns = make("span", { class: "flags", "data-part": "concerns" });
    this._legend = make("p", { class: "legend" }, LEGEND);
    this._numbers = new Numbers();
    this._controls = new Controls(model);
    this._marks = new MarksCard(model);
    this.keys = /** @type {import("../keys.js").Map} */ ({
      ...this._controls.keys,
      b: ["probe or cuboid", () => this._nextBody()],
      m: ["mark: a value or a note", () => this._marks.focus()],
    });
    this._body = choice(
      "Body",
      [
        ["probe", "probe"],
        ["cuboid", "cuboid"],
      ],
      (kind) => this._setBody(kind),
    );
    this._body.value = kept("body", "probe");
    const camera = choice(
      "View from",
      [
        ["world", "fixed view"],
        ["behind", "from behind"],
      ],
      (from) => this.scene?.orbit.setBehind(from === "behind"),
    );
    const picture = make("button", { onclick: () => this._savePicture() }, "Save picture");
    this.element = make(
      "section",
      { class: "probe view" },
      make(
        "div",
        { class: "picture" },
        this._stage,
        make(
          "div",
          { class: "over top-left" },
          this._state,
          this._age,
          this._flags,
          this._concerns,
        ),
        make("div", { class: "over bottom-left" }, this._body, camera, picture, this._legend),
      ),
      make("aside", { class: "side" }, this._numbers.element, this._controls.element, this._marks.element),
    );
    this.scene = pictured(this._stage, () => new Scene(this._stage));
    this._setBody(this._body.value);
  }

  close() {
    this.scene?.close();
    this._controls.close();
  }

  recolour() {
    this.scene?.recolour();
  }

  /** @param {number} hz frames a second */
  adapt(hz) {
    this.scene?.adapt(hz);
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const probe = this._model.probe;
    this._controls.draw();
    this._marks.draw();
    if (probe !== undefined) {
      const isStale = probe.isStale(nowMs) || this._model.link.state !== "open";
      if (probe.pose !== null) {
        this.scene?.showPath(this._model.strokes, probe.pose.position_m);
        this.scene?.show(probe.pose);
      }
      this.scene?.setStale(isStale);
      if (nowMs - this._numbersMs >= NUMBERS_MS) {
        this._numbersMs = nowMs;
        this._show(probe, nowMs, isStale);
      }
    }
    this.scene?.draw();
  }

  /**
   * @param {Probe} probe
   * @param {number} nowMs
   * @param {boolean} isStale
   */
  _show(probe, nowMs, isStale) {
    this._numbers.show(probe, this._model.strokes, isStale);
    if (nowMs - this._describedMs >= DESCRIBE_MS) {
      this._describedMs = nowMs;
      this.scene?.describe(described(probe, isStale));
    }
    const radius = this.scene?.path.radius_m ?? 0;
    say(this._legend, radius ? `two sigma; the ring's radius is ${radius * 100} cm` : LEGEND);
    const state = probe.state(nowMs);
    say(this._state, STATES[state]?.[0] ?? state);
    mark(this._state, "class", `chip ${STATES[state]?.[1] ?? ""}`);
    this._age.hidden = !isStale || probe.pose === null;
    say(this._age, `${span((nowMs - probe.poseMs) / 1000)} old`);
    showChips(this._flags, (probe.pose?.flags ?? []).map(flagWords));
    showChips(this._concerns, concerns(probe.status), "sentence");
  }

  async _savePicture() {
    const { selected } = this._model;
    const picture = await this.scene?.picture();
    if (picture) {
      save(`${selected}-${new Date().toISOString().slice(0, 19)}.png`, picture);
    }
  }

  /** @param {string} kind */
  _setBody(kind) {
    keep("body", kind);
    this.scene?.setBody(kind === "cuboid" ? "cuboid" : "probe");
  }

  _nextBody() {
    this._body.value = this._body.value === "cuboid" ? "probe" : "cuboid";
    this._setBody(this._body.value);
  }
}
