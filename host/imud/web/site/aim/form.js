// SPDX-License-Identifier: MIT
// @ts-check
// Enters a target: angles, what has to agree, how well and for how long.

import { make } from "../dom.js";
import { fromAngles, toAngles } from "../rotation.js";
import { DEFAULTS } from "./targets.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("../rotation.js").Quat} Quat */
/** @typedef {import("../rotation.js").Convention} Convention */

const AXES = [
  ["x", "x axis"],
  ["y", "y axis"],
  ["z", "z axis"],
  ["all", "attitude"],
];

/**
 * The browser refuses what is out of range.
 * @param {string} name
 * @param {number} value
 * @param {number} min
 * @param {number} max
 */
function number(name, value, min, max) {
  return make("input", { type: "number", step: "any", name, value, min, max, required: true });
}

/**
 * @param {string} text
 * @param {HTMLElement} input
 */
function field(text, input) {
  return make("label", { class: "field" }, text, input);
}

/** A card with the fields. */
export class Form {
  /**
   * @param {Convention} convention
   * @param {string} name
   * @param {{ aim: (target: Target) => void, capture: () => void, origin: () => void }} events
   */
  constructor(convention, name, { aim, capture, origin }) {
    this._convention = convention;
    this._yaw = number("yaw", 0, -360, 360);
    this._pitch = number("pitch", 0, -90, 90);
    this._roll = number("roll", 0, -360, 360);
    this._name = make("input", { name: "name", value: name, maxlength: 60, required: true });
    const options = AXES.map(([value, text]) => make("option", { value }, text));
    this._axis = make("select", { name: "axis" }, ...options);
    this._tolerance = number("tolerance", DEFAULTS.tolerance_deg, 0.01, 180);
    this._hold = number("hold", DEFAULTS.hold_s, 0, 600);
    const submit = (/** @type {Event} */ event) => {
      event.preventDefault();
      aim(this._target(this._entered()));
    };
    this.element = make(
      "form",
      { class: "card", onsubmit: submit },
      make("h2", {}, `Desired orientation, ${convention} angles`),
      field("Name", this._name),
      make(
        "div",
        { class: "three" },
        field("Yaw °", this._yaw),
        field("Pitch °", this._pitch),
        field("Roll °", this._roll),
      ),
      make(
        "div",
        { class: "three" },
        field("What counts", this._axis),
        field("Tolerance °", this._tolerance),
        field("Hold s", this._hold),
      ),
      make(
        "div",
        { class: "row" },
        make("button", { class: "primary" }, "Aim"),
        make("button", { type: "button", onclick: capture }, "Capture this orientation"),
        make("button", { type: "button", onclick: origin }, "Set origin"),
      ),
    );
  }

  submit() {
    this.element.requestSubmit();
  }

  /** @param {string} name the name of the next target */
  rename(name) {
    this._name.value = name;
  }

  /**
   * A target of that orientation, which is entered into the fields.
   * @param {Quat} q
   * @param {string} capture how the daemon names this moment; empty: it does not
   */
  captured(q, capture) {
    const { yaw, pitch, roll } = toAngles(q, this._convention);
    this._yaw.value = yaw.toFixed(2);
    this._pitch.value = pitch.toFixed(2);
    this._roll.value = roll.toFixed(2);
    const target = this._target(q);
    return capture ? { ...target, capture } : target;
  }

  _entered() {
    const [yaw, pitch, roll] = [this._yaw, this._pitch, this._roll].map(({ value }) =>
      Number(value),
    );
    return fromAngles({ yaw, pitch, roll }, this._convention);
  }

  /**
   * @param {Quat} q
   * @returns {Target}
   */
  _target(q) {
    return {
      name: this._name.value.trim() || "target",
      q,
      axis: /** @type {import("./target.js").Axis} */ (this._axis.value),
      tolerance_deg: Number(this._tolerance.value),
      hold_s: Number(this._hold.value),
    };
  }
}
