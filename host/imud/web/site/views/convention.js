// SPDX-License-Identifier: MIT
// @ts-check
// The convention of angles (docs/pose-details.md) that this browser's user prefers.

import { keep, kept, make } from "../dom.js";
import { CONVENTIONS } from "../rotation.js";

/** @typedef {import("../rotation.js").Convention} Convention */

/** @returns {Convention} */
export function convention() {
  const name = kept("convention", "nautical");
  return CONVENTIONS.find((one) => one === name) ?? "nautical";
}

/**
 * A field that chooses it.
 * @param {() => void} onChange
 */
export function conventionChoice(onChange) {
  const choice = make(
    "select",
    {
      "aria-label": "Convention of angles",
      onchange: () => {
        keep("convention", choice.value);
        onChange();
      },
    },
    ...CONVENTIONS.map((name) => make("option", { value: name }, name)),
  );
  choice.value = convention();
  return choice;
}
