// SPDX-License-Identifier: MIT
// @ts-check
// Those verdicts of `imud check` that a status tells: no motion, no spectra, no clock.

import { make, scrolling } from "../dom.js";
import { FINGERPRINT, SPECIFIED_DEGC, SUPPLY_MV, WARM_DEGC } from "./wire.js";

/** @typedef {[name: string, measured: string, normal: string, verdict: string, advice?: string]} Row */

const [GOOD, SKIPPED, LOOK, FAULT] = ["good", "not judged", "look at this", "fault"];
const KINDS = /** @type {Record<string, string>} */ ({ [GOOD]: "good", [LOOK]: "warn", [FAULT]: "bad" });
const SLOW = 0.9; // of the wanted rate

/**
 * Good up to one limit, a fault beyond the other.
 * @param {number | null} value
 * @param {readonly number[]} good from, to
 * @param {readonly number[]} possible from, to
 */
function within(value, good, possible) {
  if (value === null || value === undefined) {
    return SKIPPED;
  }
  const isIn = (/** @type {readonly number[]} */ [low, high]) => value >= low && value <= high;
  return isIn(good) ? GOOD : isIn(possible) ? LOOK : FAULT;
}

/**
 * @param {any} status
 * @returns {Row[]}
 */
export function rowsOf({ ledger, hello, counters, sensors, pose_rate_hz: rate, state }) {
  const { lost, corrupt } = ledger;
  const { overruns = 0, bus_faults: faults = 0, supply = null, temperature = null } = counters;
  const wanted = hello.pose_rate;
  const isFast = rate >= SLOW * wanted;
  const isTested = hello.self_test.some((/** @type {string} */ flag) => /_(passed|failed)$/.test(flag));
  const tested = isTested ? hello.self_test.join(", ").replaceAll("_", " ") : "judged by imud check alone";
  const [low, high, least] = SUPPLY_MV[hello.board] ?? [0, Infinity, 0];
  const causes = hello.reset_cause.join(" and ").replaceAll("_", " ") || "unknown cause";
  const isLossy = lost + corrupt > 0;
  return [
    ["messages lost", `${lost} messages, ${corrupt} frames corrupt`, "0", isLossy ? LOOK : GOOD, "another cable or USB port, without a hub"],
    ["rate", `${rate} poses a second`, `${wanted}`, state !== "streaming" ? SKIPPED : isFast ? GOOD : LOOK, "the link is too slow, or this computer busy"],
    ["samples", `${overruns} overruns, ${faults} bus faults`, "0", overruns + faults > 0 ? LOOK : GOOD, "check the sensor's wires: short, and soldered"],
    ["sensor", sensors.words.join("; ") || hello.sensor, "answers", sensors.words.length ? FAULT : GOOD, "replace the module"],
    ["self-test", tested, "passed", !isTested ? SKIPPED : sensors.flags.length ? FAULT : GOOD, "replace the module"],
    ["start", `boot ${hello.boot_count}, by ${causes}`, "no hard fault", /hard|brown|watch/.test(causes) ? LOOK : GOOD, "check its supply; else send imud check's report"],
    ["supply", supply === null ? "not measured" : `${supply} mV`, `${low} to ${high} mV`, within(supply, [low, high], [least, Infinity]), "another cable or USB port"],
    ["temperature", temperature === null ? "not measured" : `${temperature} °C`, WARM_DEGC.join(" to ") + " °C", within(temperature, WARM_DEGC, SPECIFIED_DEGC), "let it come to the room's temperature"],
  ];
}

/** A card with the verdicts on the selected probe. */
export class CheckCard {
  /** @param {import("../model.js").Model} model */
  constructor(model) {
    this._model = model;
    this._shown = "";
    this._rows = make("tbody", {});
    this.element = make(
      "div",
      { class: "card", hidden: true, "data-part": "check" },
      make("h2", {}, "Check"),
      scrolling("Check", ["checked", "measured", "normal", "verdict"], this._rows),
      make("p", { class: "muted small" }, "What the probe says of itself. imud check also has it moved, and judges noise, axes, clock and field."),
    );
  }

  draw() {
    const status = this._model.probe?.status;
    this.element.hidden = status?.hello?.schema_fingerprint !== FINGERPRINT;
    const rows = this.element.hidden ? [] : rowsOf(status);
    const text = JSON.stringify(rows);
    if (text !== this._shown) {
      this._shown = text;
      this._rows.replaceChildren(...rows.map((row) => this._row(row)));
    }
  }

  /** @param {Row} row */
  _row([name, measured, normal, verdict, advice = ""]) {
    const chip = make("span", { class: `chip ${KINDS[verdict] ?? ""}` }, verdict);
    const isBad = verdict === LOOK || verdict === FAULT;
    const told = make("td", {}, chip, isBad ? make("span", { class: "muted small" }, ` ${advice}`) : "");
    return make("tr", {}, make("th", { scope: "row" }, name), make("td", {}, measured), make("td", {}, normal), told);
  }
}
