// SPDX-License-Identifier: MIT
// @ts-check
// Sets up a limb: which probe is on which segment. The daemon keeps it by its name, and
// runs it.

import { make, mark, question, say } from "../dom.js";
import { attempt } from "../header.js";

/** @typedef {import("../model.js").Model} Model */
/** @typedef {import("../link.js").LimbSetup} Setup */
/** @typedef {Setup & { name: string }} Saved */

const NEW = "right-leg";

/** A card. */
export class SetupCard {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    /** @type {Saved[]} */
    this._saved = [];
    /** @type {Map<string, HTMLSelectElement>} */
    this._probes = new Map();
    this._listed = "";
    this._isAsked = false;
    const pattern = "[A-Za-z0-9][A-Za-z0-9_.\\-]*";
    const title = "letters, digits, dots, - and _";
    this._name = make("input", { name: "limb-name", value: NEW, maxlength: 60, required: true, pattern, title });
    this._side = make("select", { "aria-label": "Side of the body" }, ...["right", "left"].map(option));
    this._known = make("select", { "aria-label": "Saved limbs", onchange: () => this._fill() });
    this._rows = make("div", { class: "stack" });
    this._start = make("button", { class: "primary" }, "Save and start");
    this._why = make("p", { class: "notice", role: "alert", hidden: true });
    const onsubmit = (/** @type {Event} */ event) => {
      event.preventDefault();
      this._submit();
    };
    this._form = make(
      "form",
      { class: "stack", onsubmit },
      this._known,
      make("div", { class: "row end" }, make("label", { class: "field grow" }, "Name", this._name), this._side),
      this._rows,
      make("div", { class: "row" }, this._start),
    );
    this._runs = make("b", {});
    const end = make("button", { onclick: () => attempt(() => model.link.limb(null)) }, "End");
    this._running = make("div", { class: "row" }, this._runs, end);
    this._dialog = make("dialog", { "aria-label": "Replace the saved limb" });
    this.element = make(
      "div",
      { class: "card setup", hidden: true },
      make("h2", {}, "Set up a limb"),
      this._running,
      this._form,
      this._why,
      this._dialog,
    );
  }

  close() {
    this._dialog.close();
  }

  draw() {
    const { page, mayCommand, link } = this._model;
    this.element.hidden = !page.limbs || !mayCommand;
    if (this.element.hidden) {
      this._isAsked = false;
      return;
    }
    if (!this._isAsked) {
      this._isAsked = true;
      this._ask();
    }
    const { running, why } = page.limbs;
    this._running.hidden = !running;
    this._form.hidden = Boolean(running);
    this._why.hidden = Boolean(running) || !why;
    say(this._why, why);
    say(this._runs, `${running} runs.`);
    mark(this._start, "disabled", link.state !== "open");
    this._list();
  }

  async _ask() {
    await attempt(async () => {
      const { segments, saved } = await this._model.link.limbs();
      this._saved = saved;
      this._known.replaceChildren(make("option", { value: "" }, "A new limb"), ...saved.map(({ name }) => option(name)));
      this._known.hidden = saved.length === 0;
      if (this._probes.size === 0) {
        this._probes = new Map(segments.map((name) => [name, make("select", { name: `on-${name}` })]));
        const rows = [...this._probes].map(([name, select]) => make("label", { class: "field" }, name, select));
        this._rows.replaceChildren(...rows);
      }
    });
  }

  /** The probes to choose from; the lists stay as they are while these do. */
  _list() {
    const { probes } = this._model;
    const all = [...probes.values()].flatMap(({ name, status }) => {
      return status?.probe_id ? [[String(status.probe_id), this._model.labelOf(name)]] : [];
    });
    const listed = JSON.stringify([all, this._probes.size]);
    if (listed !== this._listed) {
      this._listed = listed;
      for (const select of this._probes.values()) {
        const chosen = select.value;
        const items = all.map(([id, label]) => make("option", { value: id }, label));
        select.replaceChildren(make("option", { value: "" }, "no probe"), ...items);
        this._choose(select, chosen);
      }
    }
  }

  /**
   * @param {HTMLSelectElement} select
   * @param {string} id of a probe, perhaps one that is away; empty: none
   */
  _choose(select, id) {
    if (![...select.options].some(({ value }) => value === id)) {
      select.append(make("option", { value: id }, `${id} (away)`));
    }
    select.value = id;
  }

  /** Takes over the saved limb that is chosen. */
  _fill() {
    const saved = this._saved.find(({ name }) => name === this._known.value);
    this._name.value = saved?.name ?? NEW;
    this._side.value = saved?.side ?? "right";
    for (const [name, select] of this._probes) {
      this._choose(select, saved?.probes[name] ?? "");
    }
  }

  _submit() {
    const name = this._name.value;
    const chosen = [...this._probes].filter(([, { value }]) => value !== "").map(([segment, { value }]) => [segment, value]);
    const setup = { side: this._side.value, probes: Object.fromEntries(chosen) };
    const saved = this._saved.find((one) => one.name === name);
    const isSame = saved && saved.side === setup.side && String(Object.entries(saved.probes)) === String(chosen);
    if (saved && !isSame) {
      const text = "A limb of this name is saved with other probes or another side.";
      question(this._dialog, `Replace ${name}?`, text, "Replace", () => this._run(name, setup, true));
    } else {
      this._run(name, saved ? undefined : setup);
    }
  }

  /**
   * @param {string} name
   * @param {Setup} [setup] none: as it is saved
   * @param {boolean} [replace]
   */
  async _run(name, setup, replace = false) {
    this._start.disabled = true;
    await attempt(() => this._model.link.limb(name, setup, replace));
    this._start.disabled = false;
    this._isAsked = false; // it is saved, perhaps
  }
}

/** @param {string} name */
function option(name) {
  return make("option", { value: name }, name);
}
