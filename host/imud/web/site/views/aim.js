// SPDX-License-Identifier: MIT
// @ts-check
// Bring the probe to a desired orientation, and keep a protocol of what was reached.

import { keep, kept, make, mark } from "../dom.js";
import { span } from "../format.js";
import { attempt, tell } from "../header.js";
import { Form } from "../aim/form.js";
import { Hold } from "../aim/hold.js";
import { List } from "../aim/list.js";
import { Polar } from "../aim/polar.js";
import { Protocol } from "../aim/protocol.js";
import { Reading } from "../aim/reading.js";
import { chime } from "../sound.js";
import { Targets } from "../aim/targets.js";
import { judge, nameOf } from "../aim/target.js";
import { setOrigin } from "../commands.js";
import { convention } from "./convention.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../aim/target.js").Target} Target */

const NUMBERS_MS = 50;

/** A view of the selected probe. */
export class AimView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this.every = ["pose", "aim"];
    this._convention = convention();
    this._targets = new Targets();
    this._hold = new Hold();
    this._polar = new Polar();
    this._reading = new Reading();
    this._protocol = new Protocol();
    /** @type {Target | null} */
    this._target = null;
    this._numbersMs = 0;
    this._told = "";
    this._toldProbe = "";
    this._form = new Form(this._convention, this._targets.freshName(), {
      aim: (target) => this._add(target),
      capture: () => this._capture(),
      origin: () => setOrigin(model, "all"),
    });
    this._list = new List(this._targets, this._convention, {
      choose: (target) => this._aimAt(target),
      next: () => this._next(),
    });
    this.element = make(
      "section",
      { class: "aim view" },
      make(
        "div",
        // It scrolls on a tablet, also by the keyboard.
        { class: "chartside", tabindex: "0", role: "region", "aria-label": "aim" },
        this._polar.element,
        this._reading.element,
      ),
      make(
        "div",
        { class: "side" },
        this._form.element,
        this._list.element,
        this._protocol.element,
      ),
    );
    this.keys = /** @type {import("../keys.js").Map} */ ({
      a: ["aim at the entered angles", () => this._form.submit()],
      c: ["capture the orientation", () => this._capture()],
      n: ["next target", () => this._next()],
    });
    const name = kept("target", "");
    this._aimAt(this._targets.all.find((one) => one.name === name) ?? null);
  }

  close() {
    this._tell("off=1");
  }

  /**
   * Has the daemon publish the aim at a target, as imud/<probe>/aim; says nothing where
   * that is not allowed.
   * @param {string} query
   */
  _tell(query) {
    const { selected, mayCommand, link } = this._model;
    const key = `${selected} ${query}`;
    if (key === this._told || !mayCommand || !selected) {
      return;
    }
    if (this._told && this._toldProbe !== selected) {
      link.ask(this._toldProbe, "aim", { off: "1" }).catch(() => {});
    }
    this._told = key;
    this._toldProbe = selected;
    const parameters = Object.fromEntries(new URLSearchParams(query));
    link.ask(selected, "aim", parameters).catch(() => {});
  }

  /** The target as the daemon needs it. */
  get _aim() {
    if (this._target === null) {
      return "off=1";
    }
    const { q, axis, tolerance_deg: tolerance, hold_s: hold, capture } = this._target;
    return new URLSearchParams({
      q: q.join(","),
      target: nameOf(this._target),
      axis,
      tolerance_deg: String(tolerance),
      hold_s: String(hold),
      ...(capture ? { capture } : {}),
    }).toString();
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { probe, link } = this._model;
    const target = this._target;
    if (link.state === "open") {
      this._tell(this._aim);
    } else {
      this._told = "";
    }
    const pose = probe?.pose ?? null;
    const isStale = probe === undefined || probe.isStale(nowMs) || link.state !== "open";
    mark(this.element, "data-stale", isStale);
    if (pose === null || target === null) {
      this._reading.none(target === null ? "Enter or capture a target" : "No pose yet");
      this._polar.clear();
      mark(this.element, "data-state", "off");
      return;
    }
    const verdict = judge(pose, target, this._convention, probe?.aim ?? null);
    if (isStale) {
      this._hold.interrupt();
      verdict.state = "off";
    } else {
      const reached = this._hold.take(pose, target, verdict);
      if (reached !== null) {
        this._protocol.add(reached);
        this._finish();
      }
    }
    this._polar.show(target, verdict, this._hold.share(target));
    mark(this.element, "data-state", verdict.state);
    if (nowMs - this._numbersMs >= NUMBERS_MS) {
      this._numbersMs = nowMs;
      const age = isStale && probe ? span((nowMs - probe.poseMs) / 1000) : "";
      this._reading.show(verdict, this._hold.isDone, age, pose, target);
    }
  }

  _finish() {
    if (this._list.hasSound) {
      chime();
    }
    if (this._list.goesOn) {
      this._next();
    }
  }

  /** Takes the orientation of this moment as the target; the daemon keeps the moment. */
  async _capture() {
    const { probe, selected, mayCommand, link } = this._model;
    if (!probe?.pose) {
      tell("There is no pose to capture", true);
      return;
    }
    let { q } = probe.pose;
    let capture = "";
    if (mayCommand) {
      const answer = await attempt(() => link.ask(selected, "capture"));
      if (answer === undefined) {
        return;
      }
      ({ q, capture = "" } = answer.value);
    }
    this._add(this._form.captured(q, capture));
  }

  /** @param {Target} target */
  _add(target) {
    this._targets.add(target);
    this._form.rename(this._targets.freshName());
    this._aimAt(target);
  }

  /** @param {Target | null} target */
  _aimAt(target) {
    this._target = target;
    this._hold.clear();
    keep("target", target?.name ?? "");
    this._reading.goal(target);
    this._list.show(target?.name ?? "");
  }

  _next() {
    this._aimAt(this._targets.after(this._target?.name ?? "") ?? null);
  }
}
