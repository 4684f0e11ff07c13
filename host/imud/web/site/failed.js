// SPDX-License-Identifier: MIT
// @ts-check
// What stands in place of a view that has failed: why, and what to do about it.

import { make, save } from "./dom.js";

/**
 * @typedef {object} Failure
 * @property {string} title of the view
 * @property {string} imud its version
 * @property {unknown} error
 */

/**
 * @param {Failure} about
 * @param {() => void} again opens the view anew
 */
export function failed(about, again) {
  const { title, error } = about;
  const text = report(about);
  const words = error instanceof Error ? error.message : String(error);
  return make(
    "section",
    { class: "view failed", role: "alert", "data-part": "failed" },
    make(
      "div",
      { class: "card" },
      make("h1", {}, `${title} has failed`),
      make("p", {}, "That is a fault of this page, not of the probe. All other views go on, and so does the daemon."),
      make("pre", {}, words),
      make(
        "div",
        { class: "row" },
        make("button", { class: "primary", onclick: again }, "Open it again"),
        make("button", { onclick: () => save("imud-report.txt", new Blob([text])) }, "Save a report"),
      ),
      make(
        "p",
        { class: "muted" },
        "The report has the fault, where it happened, and the versions of imud and of this browser: send it with your bug report.",
      ),
    ),
  );
}

/** @param {Failure} about */
function report({ title, imud, error }) {
  const stack = error instanceof Error ? (error.stack ?? "") : "";
  return [
    `imud ${imud}, view ${title}, at ${location.hash}`,
    navigator.userAgent,
    new Date().toISOString(),
    String(error),
    stack,
    "",
  ].join("\n");
}
