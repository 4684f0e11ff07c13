// SPDX-License-Identifier: MIT
// @ts-check
// The numbers of one probe: each with its unit and its error.

import { make, mark, say } from "../dom.js";
import { angle, fixed, micros, sigma, span, UNKNOWN, whole } from "../format.js";
import { errorsOf } from "../model.js";
import { POSE_NUMBERS } from "../published.js";
import { heading, toAngles } from "../rotation.js";
import { Accuracy } from "./accuracy.js";
import { convention, conventionChoice } from "./convention.js";
import { both, voidWords } from "./words.js";

/** @typedef {import("../model.js").Pose} Pose */
/** @typedef {import("../model.js").Probe} Probe */
/** @typedef {import("../link.js").Line} Line */

const SIGMAS = 1.96; // 95 % of errors are within
const LATE_US = 300e3; // an age above it is shown without being asked for
const SLOW = 0.9; // so is a rate below this share of the wanted one

// The numbers of a pose that stand beside no angle, by their names.
const OTHERS = POSE_NUMBERS.filter((name) => !/^(tilt|heading)_sigma_deg$/.test(name));

/** A row: name, value with unit, error. */
class Quantity {
  /**
   * @param {string} name
   * @param {string} unit
   * @param {string} [key]
   */
  constructor(name, unit, key = name.toLowerCase()) {
    this._value = make("span", { class: "value", "data-value": key }, UNKNOWN);
    this._error = make("span", { class: "error-of", "data-sigma": key }, "");
    const number = make("dd", {}, this._value, make("span", { class: "unit" }, unit), this._error);
    this.row = make("div", { class: "quantity" }, make("dt", {}, name), number);
  }

  /**
   * Shows a value; null hides the row.
   * @param {string | null} value
   * @param {string} [error]
   */
  show(value, error = "") {
    this.row.hidden = value === null;
    say(this._value, value ?? "");
    say(this._error, error);
  }

  /**
   * An angle; one whose error is not known has no decimals to rely on.
   * @param {number} degrees
   * @param {number | null} error one sigma
   */
  angle(degrees, error) {
    this.show(error === null ? fixed(degrees, 0, 4) : angle(degrees), sigma(error));
    mark(this.row, "data-unknown", error === null);
  }
}

/**
 * Relative to what the errors above are.
 * @param {import("../model.js").Since} since
 */
function sinceWords(since) {
  if (since.void !== null) {
    return `Errors since the origin are unknown: ${voidWords(since.void)}. Set the origin again.`;
  }
  return `Errors since the origin, ${span(since.age_s ?? 0)} ago`;
}

/** A card with the numbers. */
export class Numbers {
  constructor() {
    this._convention = convention();
    this._yaw = new Quantity("Yaw", "°");
    this._pitch = new Quantity("Pitch", "°");
    this._roll = new Quantity("Roll", "°");
    this._since = make("p", { class: "muted", "data-part": "since", hidden: true });
    this._heading = new Quantity("From north", "°", "heading");
    this._tip = new Quantity("Tip", "mm");
    this._stroke = new Quantity("Stroke", "mm");
    this._closure = new Quantity("Closure", "mm");
    this._rate = new Quantity("Rate", "Hz");
    this._lost = new Quantity("Lost", "");
    this._age = new Quantity("Age", "");
    this._battery = new Quantity("Battery", "V");
    this._radio = new Quantity("Radio", "");
    this._card = new Quantity("Card", "");
    this._others = OTHERS.map((name) => new Quantity(name.replaceAll("_", " "), ""));
    // What a probe may not have is shown once it has it.
    for (const each of [this._tip, this._stroke, this._closure, this._battery, this._radio, this._card]) {
      each.show(null);
    }
    const choice = conventionChoice(() => {
      this._convention = convention();
    });
    this._accuracy = new Accuracy();
    this._front = make("dl", { class: "quantities" });
    this._folded = make("dl", { class: "quantities" });
    const rows = (/** @type {Quantity[]} */ ...of) => of.map(({ row }) => row);
    this._front.append(...rows(this._tip, this._stroke, this._closure, this._battery, this._radio, this._card));
    this._folded.append(...rows(this._heading, this._rate, this._lost, this._age, ...this._others));
    this.element = make(
      "div",
      { class: "card numbers" },
      make("div", { class: "card-head" }, make("h2", {}, "Orientation"), choice),
      make(
        "dl",
        { class: "quantities large" },
        ...rows(this._yaw, this._pitch, this._roll),
      ),
      this._since,
      make("p", { class: "muted small" }, "± is one sigma: two thirds of true errors are smaller."),
      this._accuracy.element,
      this._front,
      make("details", {}, make("summary", {}, "From north, rate, lost, age"), this._folded),
    );
  }

  /**
   * @param {Probe} probe
   * @param {import("../strokes.js").Strokes} strokes
   * @param {boolean} isStale
   */
  show(probe, strokes, isStale) {
    const { pose, status } = probe;
    mark(this.element, "data-stale", isStale);
    this._accuracy.show(probe);
    if (pose !== null) {
      this._pose(pose);
    } else {
      this._tip.show(null);
    }
    this._moved(strokes.last);
    this._closed(strokes.closing);
    this._age.show(micros(pose?.age_us), pose?.t_bound_us ? `±${micros(pose.t_bound_us)}` : "");
    this._fold(this._age, (pose?.age_us ?? 0) < LATE_US);
    this._status(status);
  }

  /** @param {Pose} pose */
  _pose(pose) {
    const { yaw, pitch, roll } = toAngles(pose.q, this._convention);
    const since = pose.since_origin ?? null;
    const errors = errorsOf(pose);
    const { tilt_sigma_deg: tilt, heading_sigma_deg: turn } = errors;
    this._since.hidden = since === null;
    say(this._since, since === null ? "" : sinceWords(since));
    // NECTEC's paper calls the rotation about the vertical roll.
    const isTurned = this._convention === "nectec";
    this._yaw.angle(yaw, isTurned ? tilt : turn);
    this._pitch.angle(pitch, tilt);
    this._roll.angle(roll, isTurned ? turn : tilt);
    // From an origin of its own nothing tells where north is.
    const toNorth = heading(pose.q);
    const north = fixed(toNorth, turn === null ? 0 : 1, 5);
    this._heading.show(
      pose.flags.includes("tared") ? null : north,
      toNorth === null ? "upright" : sigma(turn),
    );
    const mm = pose.position_m?.map((metres) => fixed(metres * 1000, 1, 7));
    this._tip.show(mm?.join(" ") ?? null);
    const values = /** @type {Record<string, any>} */ (pose);
    this._others.forEach((row, index) => row.show(fixed(values[OTHERS[index]], 2)));
    mark(this.element, "data-number", String(pose.number));
  }

  /** @param {Line | null} stroke */
  _moved(stroke) {
    if (stroke === null) {
      this._stroke.show(null);
      return;
    }
    const { displacement_m: moved, displacement_sigma_m: errors, end } = stroke;
    if (!moved) {
      this._stroke.show(UNKNOWN, stroke.advice ?? end.replace("_", " "));
      return;
    }
    const [length, error] = alongOf(moved, errors);
    if (end === "running") {
      // What is hardly known yet says nothing.
      const isKnown = error < 0.2 * length;
      this._stroke.show(isKnown ? fixed(1000 * length, 1, 7) : UNKNOWN, "moving");
    } else {
      this._stroke.show(fixed(1000 * length, 1, 7), `±${fixed(1000 * error, 1)} mm`);
    }
  }

  /**
   * How far a closed path is off, and what its strokes' errors explain of that; of one
   * there and back how far it went.
   * @param {Line | null} closing
   */
  _closed(closing) {
    if (closing === null) {
      this._closure.show(null);
      return;
    }
    const off = 1000 * Math.hypot(...closing.off_m);
    const explained = 1000 * SIGMAS * Math.hypot(...closing.off_sigma_m);
    let words = `95 %: ±${fixed(explained, 1)} mm`;
    const { strokes, closed_m: places, closed_sigma_m: errors } = closing;
    if (!places) {
      words += "; it did not return, or a stroke is wrong";
    } else if (strokes === 2) {
      const [length, error] = alongOf(places[0], errors[0]);
      words += `; there ${fixed(1000 * length, 1)} ±${fixed(1000 * error, 1)} mm`;
    }
    this._closure.show(fixed(off, 1, 7), words);
    mark(this._closure.row, "data-kind", closing.is_explained ? false : "warn");
  }

  /**
   * What is as it should be is folded away.
   * @param {Quantity} quantity
   * @param {boolean} isUsual
   */
  _fold({ row }, isUsual) {
    const place = isUsual ? this._folded : this._front;
    if (row.parentElement !== place) {
      place.append(row);
    }
  }

  /** @param {Line | null} status */
  _status(status) {
    const ledger = status?.ledger;
    const equipment = status?.equipment;
    this._rate.show(fixed(status?.pose_rate_hz, 1));
    const lost = both(ledger, "lost");
    const sent = both(ledger, "sent");
    this._lost.show(whole(lost), sent ? `of ${whole(sent)}` : "");
    this._fold(this._lost, lost === 0);
    this._fold(this._rate, status?.state !== "streaming" || status.pose_rate_hz > SLOW * status.hello?.pose_rate);
    mark(this._lost.row, "data-kind", lost ? "warn" : false);
    const volts = equipment?.battery_v ?? null;
    const power = (equipment?.power ?? []).join(", ");
    this._battery.show(volts === null ? null : fixed(volts, 2), power);
    this._radio.show(equipment?.radio?.state ?? null);
    this._card.show(equipment?.card?.state ?? null);
  }
}

/**
 * The length of a displacement, and the error along it.
 * @param {number[]} moved
 * @param {number[] | null} errors of each axis
 */
function alongOf(moved, errors) {
  const length = Math.hypot(...moved);
  const along = moved.map((part, axis) => {
    return (part * (errors?.[axis] ?? NaN)) / Math.max(length, 1e-9);
  });
  return [length, Math.hypot(...along)];
}
