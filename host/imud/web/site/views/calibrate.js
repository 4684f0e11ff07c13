// SPDX-License-Identifier: MIT
// @ts-check
// Calibrates the selected probe: guides the user, shows the covered directions, and
// activates the result.

import { make, pictured } from "../dom.js";
import { attempt, tell } from "../header.js";
import { Cloud } from "../calibrate/cloud.js";
import { Ghost } from "../calibrate/ghost.js";
import { Cover } from "../calibrate/cover.js";
import { GuideCard } from "../calibrate/guide.js";
import { ResultCard } from "../calibrate/result.js";
import { coloursOf, Scene } from "../scene/scene.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../link.js").Line} Line */

const LEGEND = "pale: the next pose; arrow: the turn to it; green: covered directions; blue: the next direction";

/** A view of the selected probe. */
export class CalibrateView {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this.every = ["raw"];
    this._cover = new Cover();
    this._ghost = new Ghost();
    this._cloud = new Cloud();
    this._guide = new GuideCard({
      begin: () => this._do(this._guide.kind.value),
      end: () => this._do("end"),
      stop: () => this._do("stop"),
    });
    this._result = new ResultCard({
      apply: () => this._change("outcome"),
      undo: () => this._change("before"),
    });
    this._stage = make("div", { class: "stage" });
    this._legend = make("p", { class: "legend" });
    this.element = make(
      "section",
      { class: "calibrate view" },
      make(
        "div",
        { class: "picture" },
        this._stage,
        make("div", { class: "over bottom-left" }, this._legend),
      ),
      make("aside", { class: "side" }, this._guide.element, this._result.element, this._cloud.element),
    );
    this.keys = /** @type {import("../keys.js").Map} */ ({
      b: ["begin", () => this._guide.begin.click()],
      e: ["finish now", () => this._do("end")],
      x: ["cancel", () => this._do("stop")],
      y: ["apply", () => this._result.apply.click()],
      u: ["undo", () => this._result.undo.click()],
    });
    this.scene = pictured(this._stage, () => new Scene(this._stage, this._cover.group, this._ghost.group));
    this.recolour();
    this._take = (/** @type {Event} */ event) => {
      this._hear(/** @type {CustomEvent<Line>} */ (event).detail);
    };
    model.addEventListener("probe", this._take);
  }

  close() {
    this._model.removeEventListener("probe", this._take);
    this.scene?.close();
  }

  recolour() {
    this.scene?.recolour();
    this._cover.recolour(coloursOf());
    this._ghost.recolour(coloursOf());
    this._cloud.recolour();
  }

  /** @param {number} hz frames a second */
  adapt(hz) {
    this.scene?.adapt(hz);
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { probe, mayCommand, link } = this._model;
    const line = probe?.calibration ?? null;
    const isOn = line !== null && line.phase !== "none";
    this._guide.show(line, mayCommand && probe !== undefined && this._model.mayRead("calibration"));
    const isFresh = probe !== undefined && !probe.isStale(nowMs) && link.state === "open";
    this._result.show(line, probe, isFresh, mayCommand);
    this._cloud.fit(isOn ? (line.ellipsoid ?? null) : null);
    this._cloud.draw();
    const isGuided = isOn && line.ups !== undefined;
    this._cover.group.visible = isGuided;
    if (this._cover.show(isGuided ? line.ups : [], isGuided ? line.wanted : null)) {
      this.scene?.invalidate();
    }
    if (this._ghost.show(...this._next(line, isGuided))) {
      this.scene?.invalidate();
    }
    this.scene?.describe(isGuided ? line.says : "The probe as it lies");
    this._legend.textContent = isGuided ? LEGEND : "";
    if (probe?.pose) {
      this.scene?.show(probe.pose);
      this.scene?.setStale(!isFresh);
    }
    this.scene?.draw();
  }

  /**
   * What the ghost shows: from which attitude, which direction should be up, and whether
   * half a turn is wanted. From an origin of its own, and with a module that is mounted
   * in another way, the attitude is not that of the housing.
   * @param {Line | null} line
   * @param {boolean} isGuided
   * @returns {[import("../rotation.js").Quat | null, [number, number, number] | null, boolean]}
   */
  _next(line, isGuided) {
    const pose = this._model.probe?.pose ?? null;
    const mount = line?.mount ?? null;
    const isHousing = pose !== null && !pose.flags.includes("tared") && (mount === null || mount.is_plain);
    const isShown = isGuided && line?.phase === "running" && isHousing;
    return [isShown ? pose.q : null, line?.wanted ?? null, line?.step === "half_turn"];
  }

  /** @param {Line} line */
  _hear(line) {
    const { selected, probe } = this._model;
    const lsb = probe?.status?.hello?.mag_lsb;
    if (line.probe !== selected || line.type !== "raw" || !line.mag_counts || !lsb) {
      return;
    }
    this._cloud.add(line.mag_counts.map((/** @type {number} */ count) => count * lsb));
  }

  /** @param {string} kind */
  async _do(kind) {
    const { link, selected } = this._model;
    if (kind in { all: 1, mag: 1 }) {
      this._cloud.clear();
    }
    await attempt(() => link.calibrate(selected, kind));
  }

  /** @param {"outcome" | "before"} which params to activate */
  async _change(which) {
    const { link, probe, selected } = this._model;
    const line = probe?.calibration;
    const records = which === "outcome" ? line?.outcome?.records : line?.before;
    if (records === undefined) {
      return;
    }
    await attempt(async () => {
      await link.ask(selected, "params", { records });
      tell(which === "outcome" ? "The calibration is active" : "The previous params are active again");
    });
  }
}
