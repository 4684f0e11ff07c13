// SPDX-License-Identifier: MIT
// @ts-check
// The list of targets: choose, remove, load from a file, save.

import { make, save } from "../dom.js";
import { fixed } from "../format.js";
import { attempt, tell } from "../header.js";
import { toAngles } from "../rotation.js";
import { allowSound } from "../sound.js";

/** @typedef {import("./target.js").Target} Target */
/** @typedef {import("./targets.js").Targets} Targets */
/** @typedef {import("../rotation.js").Convention} Convention */

const FILE_MAX = 1e6; // bytes: thousands of targets

/** A card with the list. */
export class List {
  /**
   * @param {Targets} targets
   * @param {Convention} convention
   * @param {{ choose: (target: Target | null) => void, next: () => void }} events
   */
  constructor(targets, convention, { choose, next }) {
    this._targets = targets;
    this._convention = convention;
    this._choose = choose;
    this._chosen = "";
    this._items = make("ul", { class: "targets" });
    const file = make("input", { type: "file", accept: ".json,.csv", class: "hidden-label" });
    file.addEventListener("change", () => this._load(file));
    this._goesOn = make("input", { type: "checkbox", name: "next" });
    this._sounds = make("input", {
      type: "checkbox",
      name: "sound",
      onchange: () => this._sounds.checked && allowSound(),
    });
    this.element = make(
      "div",
      { class: "card" },
      make("h2", {}, "Targets"),
      this._items,
      make(
        "div",
        { class: "row" },
        make("button", { onclick: next }, "Next"),
        make("label", { class: "button" }, "Load", file),
        make("button", { onclick: () => this._save() }, "Save"),
        make("button", { class: "danger", onclick: () => this._clear() }, "Clear"),
      ),
      make("label", { class: "check" }, this._goesOn, "go to the next automatically"),
      make("label", { class: "check" }, this._sounds, "sound when reached"),
    );
  }

  get goesOn() {
    return this._goesOn.checked;
  }

  get hasSound() {
    return this._sounds.checked;
  }

  /** @param {string} chosen the name of the target that is aimed at */
  show(chosen) {
    this._chosen = chosen;
    const items = this._targets.all.map((target) => this._item(target));
    const none = make("li", { class: "muted" }, "none yet");
    this._items.replaceChildren(...(items.length ? items : [none]));
  }

  /** @param {Target} target */
  _item(target) {
    const { yaw, pitch, roll } = toAngles(target.q, this._convention);
    const words = [yaw, pitch, roll].map((value) => `${fixed(value, 1)}°`).join(", ");
    const isChosen = target.name === this._chosen;
    const choose = make(
      "button",
      {
        class: "target",
        "aria-pressed": String(isChosen),
        onclick: () => this._choose(target),
      },
      make("b", {}, target.name),
      make("span", { class: "muted" }, words),
    );
    const remove = () => {
      this._targets.remove(target.name);
      if (isChosen) {
        this._choose(null);
      } else {
        this.show(this._chosen);
      }
    };
    const label = `Remove ${target.name}`;
    return make("li", {}, choose, make("button", { "aria-label": label, onclick: remove }, "×"));
  }

  _clear() {
    this._targets.clear();
    this._choose(null);
  }

  _save() {
    const text = JSON.stringify(this._targets.all, null, 2);
    save("targets.json", new Blob([text], { type: "application/json" }));
  }

  /** @param {HTMLInputElement} input */
  async _load(input) {
    const file = input.files?.[0];
    if (file === undefined) {
      return;
    }
    await attempt(async () => {
      if (file.size > FILE_MAX) {
        throw new Error("the file is too long for a list of targets");
      }
      const count = this._targets.load(await file.text(), this._convention);
      this.show(this._chosen);
      tell(`${count} ${count === 1 ? "target" : "targets"} loaded`);
    }, file.name);
    input.value = "";
  }
}
