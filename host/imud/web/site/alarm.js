// SPDX-License-Identifier: MIT
// @ts-check
// A sound when the poses of the selected probe stop, and another when they resume, for
// a user who looks at their hands. Off until the user enables it.

import { keep, kept, make } from "./dom.js";
import { allowSound, chime } from "./sound.js";

/** @typedef {import("./model.js").Model} Model */

const LOST_MS = 500;
const LOST = [440, 330]; // Hz
const BACK = [330, 440];

let isOn = kept("alarm", false);

/** A box that switches it. */
export function alarmChoice() {
  const box = make("input", {
    type: "checkbox",
    name: "alarm",
    onchange: () => {
      isOn = box.checked;
      keep("alarm", isOn);
      allowSound();
    },
  });
  box.checked = isOn;
  if (isOn) {
    // A browser allows sounds once its user has pressed something.
    addEventListener("pointerdown", allowSound, { once: true });
  }
  return make("label", { class: "check" }, box, "sound when its poses stop");
}

/** Listens to the selected probe, whichever view is shown. */
export class Alarm {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._isHeard = false;
    this._probe = "";
  }

  /** @param {number} nowMs */
  listen(nowMs) {
    const { probe, selected } = this._model;
    const isHeard = probe !== undefined && nowMs - probe.poseMs < LOST_MS;
    const isSame = selected === this._probe;
    if (isHeard !== this._isHeard && isSame && isOn) {
      chime(isHeard ? BACK : LOST);
    }
    this._isHeard = isHeard;
    this._probe = selected;
  }
}
