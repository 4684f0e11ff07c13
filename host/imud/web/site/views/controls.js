// SPDX-License-Identifier: MIT
// @ts-check
// Commands to the selected probe: each button shows its result.

import { alarmChoice } from "../alarm.js";
import { run, setOrigin } from "../commands.js";
import { make, mark, question, say } from "../dom.js";
import { ButtonForm } from "../gestures.js";
import { attempt, tell } from "../header.js";
import { isAlone } from "../link.js";
import { ThereAndBack } from "./back.js";

/** @typedef {import("../model.js").Model} Model */

/** The card with the buttons. */
export class Controls {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._start = this._button("Start", "start", {});
    this._stop = this._button("Stop", "stop", {});
    this._origin = make(
      "select",
      { "aria-label": "Kind of origin" },
      make("option", { value: "all" }, "full"),
      make("option", { value: "heading" }, "heading"),
    );
    const set = make("button", { onclick: () => this._setOrigin() }, "Set origin");
    const undo = this._button("Undo", "tare", { what: "undo" });
    this._why = make("p", { class: "muted small" });
    this._pose = this._rateField("Poses a second");
    this._raw = this._rateField("Raw samples a second");
    this._sends = make("input", { type: "checkbox", name: "raw" });
    this._rates = make(
      "form",
      {
        class: "stack",
        onsubmit: (/** @type {Event} */ event) => {
          event.preventDefault();
          this._setRates();
        },
      },
      make("label", { class: "field" }, "Poses a second", this._pose),
      make("label", { class: "check" }, this._sends, "also send raw samples"),
      make("label", { class: "field" }, "Raw samples a second", this._raw),
      make("div", { class: "row" }, make("button", {}, "Apply")),
    );
    this._confirm = make("dialog", { "aria-label": "Reset calibration" });
    this._name = make("input", { name: "probe-name", maxlength: 60, required: true });
    this._mag = make("button", { class: "with-daemon", onclick: () => this._setMagnetometer() });
    this._log = make("button", { onclick: () => this._setLog() }, "Stop its log");
    this._gestures = new ButtonForm(model);
    this._back = new ThereAndBack(model);
    const more = make(
      "details",
      {},
      make("summary", {}, isAlone ? "Sound, rates, filter" : "Name, log, sound, rates, reset"),
      make(
        "div",
        { class: "stack inner" },
        this._makeRename(),
        make("div", { class: "row with-daemon" }, this._log),
        alarmChoice(),
        this._rates,
        make(
          "div",
          { class: "row" },
          this._button("Restart the filter", "restart", {}),
          this._mag,
          make(
            "button",
            { class: "danger with-daemon", onclick: () => this._reset() },
            "Reset calibration",
          ),
        ),
      ),
    );
    this.element = make(
      "div",
      { class: "card controls" },
      make("div", { class: "row" }, this._start, this._stop),
      make("div", { class: "row origin" }, set, this._origin, undo),
      make("div", { class: "row with-daemon" }, this._button("Close path", "close", {}), this._back.button),
      this._back.element,
      this._why,
      this._gestures.element,
      more,
      this._confirm,
    );
    this.keys = /** @type {import("../keys.js").Map} */ ({
      s: ["start", () => this._start.click()],
      x: ["stop", () => this._stop.click()],
      o: ["set origin", () => this._setOrigin()],
    });
    /** @type {string} */
    this._ratesOf = "";
  }

  close() {
    this._confirm.close();
  }

  draw() {
    const { probe, mayCommand, page, link } = this._model;
    const isOn = mayCommand && probe !== undefined;
    this._gestures.draw();
    this._back.draw(performance.now());
    for (const button of this.element.querySelectorAll("button")) {
      mark(button, "disabled", !isOn);
    }
    const isReadOnly = link.state === "open" && !page.commands;
    say(this._why, isReadOnly ? `As a ${page.role} you can't send commands.` : "");
    this._why.hidden = !isReadOnly;
    const state = probe?.state(performance.now());
    this._start.hidden = state === "streaming" || state === "calibrating";
    this._stop.hidden = !this._start.hidden;
    say(this._mag, `Switch the magnetometer ${this._isMagOff ? "on" : "off"}`);
    const isLogged = probe?.status?.log?.state !== "off";
    say(this._log, isLogged ? "Stop its log" : "Start its log");
    const hello = probe?.status?.hello;
    const rates = `${probe?.name} ${hello?.pose_rate} ${hello?.raw_rate}`;
    if (hello && rates !== this._ratesOf) {
      this._ratesOf = rates;
      this._name.value = probe?.name ?? "";
      this._pose.value = String(hello.pose_rate ?? "");
      this._raw.value = String(hello.raw_rate || hello.pose_rate || 100);
    }
  }

  /** @param {string} name */
  _rateField(name) {
    return make("input", { type: "number", min: 1, max: 1000, "aria-label": name });
  }

  /**
   * @param {string} text
   * @param {string} command
   * @param {Record<string, string>} parameters
   */
  _button(text, command, parameters) {
    const what = command === "tare" ? "Undo origin" : text;
    const onclick = () => run(this._model, what, [[command, parameters]]);
    return make("button", { "data-command": command, onclick }, text);
  }

  _setOrigin() {
    return setOrigin(this._model, this._origin.value);
  }

  _makeRename() {
    const submit = (/** @type {Event} */ event) => {
      event.preventDefault();
      this._rename();
    };
    return make(
      "form",
      { class: "row end with-daemon", onsubmit: submit },
      make("label", { class: "field grow" }, "Name", this._name),
      make("button", {}, "Rename"),
    );
  }

  /** The page follows the probe once it is heard by its new name. */
  async _rename() {
    const { link, selected } = this._model;
    await attempt(async () => {
      const { value } = await link.ask(selected, "configure", { rename: this._name.value.trim() });
      const isAlone = Boolean(value?.why);
      tell(isAlone ? `Renamed, but other hosts don't know that name: ${value.why}` : "Rename: done", isAlone);
    }, "Rename");
  }

  get _isMagOff() {
    return Boolean(this._model.probe?.status?.params?.flags?.includes("mag_off"));
  }

  _setMagnetometer() {
    const use = this._isMagOff ? "on" : "off";
    run(this._model, `Magnetometer ${use}`, [["magnetometer", { use }]]);
  }

  _setLog() {
    const isLogged = this._model.probe?.status?.log?.state !== "off";
    const log = isLogged ? "off" : "on";
    run(this._model, isLogged ? "Stop its log" : "Start its log", [["configure", { log }]]);
  }

  _setRates() {
    /** @type {[string, Record<string, string>][]} */
    const commands = [["rate", { stream: "pose", hz: this._pose.value }]];
    if (this._sends.checked) {
      commands.push(["rate", { stream: "raw", hz: this._raw.value }]);
    }
    commands.push(["fields", { streams: this._sends.checked ? "pose,raw" : "pose" }]);
    run(this._model, "Rates", commands);
  }

  _reset() {
    const text =
      "All calibration of this probe is removed, its tip and its name as well. The daemon keeps the " +
      "set: imud params history PROBE brings it back.";
    question(this._confirm, "Reset calibration?", text, "Reset", () => {
      run(this._model, "Reset calibration", [["params", { records: "" }]]);
    });
  }
}
