// SPDX-License-Identifier: MIT
// @ts-check
// The result of a calibration: the errors to expect, the residuals, apply and undo.

import { make, mark, say } from "../dom.js";
import { fixed, sigma } from "../format.js";
import { Accuracy } from "../views/accuracy.js";
import { onPage } from "../views/words.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../model.js").Probe} Probe */

const GRAVITY = 9.80665;
const DEGREES = 180 / Math.PI;
/** @type {Record<string, string>} */
const SENSORS = { acc: "accelerometer", gyr: "gyroscope", mag: "magnetometer" };
/** @type {Record<string, string>} */
const VERDICTS = { good: "good", bad: "bad", "not calibrated": "warn", "not seen": "warn" };

/**
 * The residual of a fit, in a common unit.
 * @param {string} name
 * @param {number | null} residual m/s2, rad, uT
 */
function left(name, residual) {
  if (residual === null) {
    return "calibrated";
  }
  if (name === "acc") {
    return `${fixed((1000 * residual) / GRAVITY, 2)} mg residual at the stops`;
  }
  if (name === "gyr") {
    return `${fixed(residual * DEGREES, 2)}° residual after a turn`;
  }
  return `${fixed(residual, 2)} µT residual`;
}

/** A card; hidden until there is a result. */
export class ResultCard {
  /** @param {{ apply: () => void, undo: () => void }} events */
  constructor({ apply, undo }) {
    this._list = make("dl", { class: "result" });
    this._verdict = make("span", { class: "chip" });
    this.apply = make("button", { class: "primary", onclick: apply }, "Apply");
    this.undo = make("button", { onclick: undo }, "Undo");
    this._shownText = "";
    this._step = make("p", { role: "status", "data-part": "last-step" });
    const see = make("a", { href: "#/probe", class: "button" }, "See it move");
    this._accuracy = new Accuracy();
    this._last = make("div", { class: "stack", hidden: true });
    this._last.append(this._step, this._accuracy.element, make("div", { class: "row" }, see));
    this._found = make("details", { open: true }, make("summary", {}, "This calibration"), this._list);
    this.element = make(
      "div",
      { class: "card", hidden: true },
      make("div", { class: "card-head" }, make("h2", {}, "Result"), this._verdict),
      this._last,
      this._found,
      make("div", { class: "row" }, this.apply, this.undo),
    );
  }

  /**
   * @param {Line | null} line
   * @param {Probe | undefined} probe
   * @param {boolean} isFresh whether it sends poses now
   * @param {boolean} mayCommand
   */
  show(line, probe, isFresh, mayCommand) {
    const inForce = probe?.params?.digest ?? null;
    const outcome = line?.outcome ?? null;
    const findings = line?.findings ?? [];
    this.element.hidden = line?.phase !== "done";
    if (line === null || this.element.hidden) {
      return;
    }
    const isApplied = outcome !== null && inForce === outcome.digest;
    const isBefore = inForce === line.before_digest;
    this.apply.hidden = this.undo.hidden = outcome === null;
    mark(this.apply, "disabled", !mayCommand || !isBefore || isApplied);
    mark(this.undo, "disabled", !mayCommand || !isApplied);
    if (this._last.hidden === isApplied) {
      // What counts now is in front; the calibration is a part of it.
      this._last.hidden = !isApplied;
      this._found.open = !isApplied;
    }
    if (probe && isApplied) {
      this._accuracy.show(probe);
      say(this._step, lastStep(probe, isFresh));
    }
    const isGood = findings.every((/** @type {any} */ one) => one.verdict === "good");
    const words = outcome === null ? (isGood ? "still good" : "calibrate again") : "";
    const state = isApplied ? "active" : isBefore ? "not active yet" : "other params are active";
    say(this._verdict, words || state);
    mark(this._verdict, "class", `chip ${(words ? isGood : isApplied) ? "good" : "warn"}`);
    const text = JSON.stringify([outcome, findings]);
    if (text !== this._shownText) {
      this._shownText = text;
      this._list.replaceChildren(...(outcome === null ? checked(findings) : rows(outcome)));
    }
  }
}

/**
 * The last step after a calibration is active, then the errors of the poses.
 * @param {Probe} probe
 * @param {boolean} isFresh
 */
function lastStep({ pose, status }, isFresh) {
  if (pose === null || !isFresh) {
    return "Last step: press Start above, and lay the probe still for 3 s.";
  }
  if (pose.flags.includes("uncalibrated")) {
    return "Last step: lay it on the table and let go for 3 s. This measures the gyroscope's bias and is needed after each start.";
  }
  const { tilt_sigma_deg: tilt, heading_sigma_deg: turn } = pose;
  const { tilt: noTilt, heading: noTurn } = status?.quality?.withheld ?? {};
  if (tilt === null || turn === null) {
    const why = (tilt === null ? noTilt : noTurn) ?? "it is finding level and north: a few seconds";
    return `Nearly there: ${why}.`;
  }
  return `Ready. As it lies now: tilt ${sigma(tilt)}, heading ${sigma(turn)}; two thirds of true errors are smaller.`;
}

/**
 * @param {string} name
 * @param {string} text
 * @param {string} [kind]
 */
function row(name, text, kind = "") {
  return make("div", {}, make("dt", {}, name), make("dd", { class: kind }, text));
}

/** @param {any} outcome */
function rows(outcome) {
  const found = [];
  const degrees = (/** @type {number} */ value) => `±${fixed(value, 2)}°`;
  if (outcome.tip !== null) {
    const place = outcome.tip.offset_m.map((/** @type {number} */ each) => fixed(1000 * each, 1));
    const sure = `±${fixed(1000 * outcome.tip.error_m, 1)} mm`;
    found.push(row("tip", `${place.join(", ")} mm from the sensor, ${sure}`, "value"));
  }
  if (outcome.tilt_deg !== null) {
    found.push(row("tilt", `${degrees(outcome.tilt_deg)} to expect`, "value"));
  }
  if (outcome.heading_deg !== null) {
    const where = `where ${fixed(outcome.level_uT, 1)} µT of the field are level`;
    found.push(row("heading", `${degrees(outcome.heading_deg)} to expect, ${where}`, "value"));
  }
  for (const name of outcome.sensors) {
    found.push(row(SENSORS[name], left(name, outcome.residuals[name])));
  }
  if (outcome.mount !== null) {
    found.push(row("mounting", outcome.mount.words));
  }
  if (outcome.housing_deg !== null) {
    found.push(row("housing", `the sensor is turned by ${fixed(outcome.housing_deg, 2)}°`));
  }
  if (outcome.note !== null) {
    found.push(row("surroundings", outcome.note));
  }
  return found;
}

/** @param {any[]} findings */
function checked(findings) {
  return findings.map(({ sensor, verdict, words }) => {
    const kind = VERDICTS[verdict] ?? "";
    return row(SENSORS[sensor], verdict === "good" ? words : `${verdict}: ${onPage(words)}`, kind);
  });
}
