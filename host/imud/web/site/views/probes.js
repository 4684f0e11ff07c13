// SPDX-License-Identifier: MIT
// @ts-check
// All probes: their state, and the way of their data from the sensor to each sink.

import { make, mark, say } from "../dom.js";
import { isAlone } from "../link.js";
import { CheckCard } from "../usb/check.js";
import { fixed, micros, sigma, span, UNKNOWN, whole } from "../format.js";
import { LogList } from "./logs.js";
import { PortList } from "./ports.js";
import { UpdateBox } from "./update.js";
import { both, concerns, showChips, STATES, voidWords } from "./words.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../model.js").Probe} Probe */

const DRAW_MS = 100;

/** One probe's card. */
class Row {
  /**
   * @param {Model} model
   * @param {string} name
   */
  constructor(model, name) {
    this._model = model;
    this._name = name;
    this._state = make("span", { class: "chip" });
    this._age = make("span", { class: "chip warn", hidden: true });
    /** @type {Map<string, { row: HTMLElement, value: HTMLElement }>} */
    this._facts = new Map();
    this._list = make("dl", { class: "facts" });
    this._fact("log", UNKNOWN); // the first of them
    this._update = new UpdateBox(model, name);
    this._chain = make("ol", { class: "chain" });
    this._sum = make("span", { class: "chip" });
    this._open = make("a", { href: `#/probe/${encodeURIComponent(name)}`, title: name }, name);
    this._about = make("p", { class: "muted small" });
    this._done = make("p", { class: "muted small" }); // of its calibration
    this._concerns = make("span", { class: "flags", "data-part": "concerns" });
    this.element = make(
      "article",
      { class: "card", "data-probe": name },
      make("div", { class: "card-head" }, make("h1", {}, this._open), this._age, this._state),
      this._about,
      this._done,
      this._concerns,
      this._update.element,
      this._list,
      make("div", { class: "card-head" }, make("h2", {}, "From the sensor to each sink"), this._sum),
      this._chain,
    );
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const probe = this._model.probes.get(this._name);
    if (probe === undefined) {
      return;
    }
    say(this._open, this._model.labelOf(this._name));
    const state = probe.state(nowMs);
    say(this._state, STATES[state]?.[0] ?? state);
    mark(this._state, "class", `chip ${STATES[state]?.[1] ?? ""}`);
    const isStale = probe.isStale(nowMs) || this._model.link.state !== "open";
    this._age.hidden = !isStale || probe.pose === null;
    say(this._age, `pose ${span((nowMs - probe.poseMs) / 1000)} old`);
    mark(this.element, "data-stale", isStale);
    this._quality(probe);
    this._update.draw(probe);
    if (probe.status !== null) {
      this._statusFacts(probe.status);
      this._way(probe.status);
    }
  }

  /**
   * @param {string} name
   * @param {string} text
   * @param {boolean} [isBad]
   */
  _fact(name, text, isBad = false) {
    let fact = this._facts.get(name);
    if (fact === undefined) {
      const value = make("dd", { class: "value" });
      fact = { row: make("div", { "data-fact": name }, make("dt", {}, name), value), value };
      this._facts.set(name, fact);
      this._list.append(fact.row);
    }
    say(fact.value, text);
    mark(fact.row, "data-kind", isBad ? "warn" : false);
  }

  /** @param {Probe} probe */
  _quality({ pose }) {
    const tilt = pose?.tilt_sigma_deg;
    const turn = pose?.heading_sigma_deg;
    this._fact("tilt", pose ? sigma(tilt) : UNKNOWN);
    this._fact("heading", pose ? sigma(turn) : UNKNOWN);
    const since = pose?.since_origin ?? null;
    const errors = [since?.tilt_sigma_deg, since?.heading_sigma_deg].map(sigma).join(" ");
    const lost = since?.void ?? null;
    this._fact("since the origin", since === null ? "no origin" : lost ? voidWords(lost) : errors);
  }

  /** @param {import("../link.js").Line} status */
  _statusFacts(status) {
    const { hello, ledger, clock, equipment, log } = status;
    const id = `id ${status.probe_id}`;
    const about = [hello?.board, hello?.sensor, hello?.firmware, status.port ?? "no port", id];
    say(this._about, about.filter(Boolean).join(" · "));
    showChips(this._concerns, concerns(status), "sentence");
    say(this._done, status.params?.done ?? "");
    this._fact("rate", `${fixed(status.pose_rate_hz, 1)} Hz`);
    const lost = both(ledger, "lost");
    this._fact("lost", `${whole(lost)} of ${whole(both(ledger, "sent"))}`, lost > 0);
    const corrupt = ledger?.corrupt ?? 0;
    this._fact("corrupt", whole(corrupt), corrupt > 0);
    this._fact("age", micros(status.quality?.age_us));
    this._fact("clock", clock?.bound_us == null ? UNKNOWN : `±${micros(clock.bound_us)}`);
    const drift = clock?.skew_ppm == null ? UNKNOWN : `${fixed(clock.skew_ppm, 1)} ppm`;
    this._fact("clock drift", drift);
    const reason = log?.reason ? `: ${log.reason}` : "";
    this._fact("log", `${log?.state ?? UNKNOWN}${reason}`, log?.state === "paused");
    if (equipment?.battery_v != null) {
      this._fact("battery", `${fixed(equipment.battery_v, 2)} V`, equipment.power.includes("low"));
    }
    if (equipment?.card) {
      this._fact("card", equipment.card.state, equipment.card.state === "failed");
    }
  }

  /** @param {import("../link.js").Line} status */
  _way({ ledger }) {
    const addsUp = ledger?.adds_up ?? true;
    say(this._sum, addsUp ? "adds up" : `differs: ${ledger.differs.join(", ")}`);
    mark(this._sum, "class", `chip ${addsUp ? "good" : "bad"}`);
    const steps = [];
    if (ledger?.sensor) {
      const { ready, read, overruns } = ledger.sensor;
      steps.push(["sensor", `${whole(ready)} samples`, `${whole(read)} read, ${whole(overruns)} overrun`]);
    }
    if (ledger?.probe) {
      const { sent, dropped } = ledger.probe;
      steps.push(["probe", `${whole(sent)} messages sent`, `${whole(dropped)} dropped`]);
    }
    const duplicated = both(ledger, "duplicated");
    steps.push(["wire", `${whole(both(ledger, "received"))} received`, `${whole(duplicated)} twice`]);
    for (const [name, counts] of Object.entries(ledger?.sinks ?? {})) {
      const { taken, dropped, waiting } = /** @type {any} */ (counts);
      steps.push([name, `${whole(taken)} taken`, `${whole(dropped)} dropped, ${whole(waiting)} waiting`]);
    }
    const items = steps.map(([name, much, rest]) =>
      make("li", {}, make("b", {}, name), make("span", {}, much), make("span", { class: "muted" }, rest)),
    );
    const text = JSON.stringify(steps);
    if (this._chain.dataset.text !== text) {
      this._chain.dataset.text = text;
      this._chain.replaceChildren(...items);
    }
  }
}

/** A view of all probes. */
export class ProbesView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this.every = [];
    this.hz = 1000 / DRAW_MS;
    this.keys = {};
    this._drawnMs = 0;
    /** @type {Map<string, Row>} */
    this._rows = new Map();
    this._cards = make("div", { class: "cards" });
    this._check = isAlone ? new CheckCard(model) : null;
    this._cards.append(...(this._check ? [this._check.element] : []));
    this._logs = new LogList(model);
    this._ports = new PortList(model);
    this._foot = make("p", { class: "muted small foot" });
    this.element = make(
      "section",
      { class: "probes view" },
      ...[this._cards, this._logs.element, this._ports.element, this._foot],
    );
  }

  close() {}

  /** @param {number} nowMs */
  draw(nowMs) {
    if (nowMs - this._drawnMs < DRAW_MS) {
      return;
    }
    this._drawnMs = nowMs;
    const { names, page, link } = this._model;
    this._check?.draw();
    this._logs.draw(nowMs);
    this._ports.draw(nowMs);
    for (const [name, row] of this._rows) {
      if (!names.includes(name)) {
        row.element.remove();
        this._rows.delete(name);
      }
    }
    for (const name of names) {
      if (!this._rows.has(name)) {
        const row = new Row(this._model, name);
        this._rows.set(name, row);
        this._cards.append(row.element);
      }
      this._rows.get(name)?.draw(nowMs);
    }
    const served = isAlone ? "without a daemon" : "served by the daemon";
    const where = page.connect ? `connected to ${page.connect}` : served;
    const left = link.leftOut ? `, ${whole(link.leftOut)} left out for this browser` : "";
    say(this._foot, `imud ${page.imud}, ${where}; ${page.role}${left}`);
  }
}
