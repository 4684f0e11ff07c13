// SPDX-License-Identifier: MIT
// @ts-check
// Replaces a view that has failed: the cause, and the remedy.

import { make, save } from "./dom.js";

/**
 * @typedef {object} Failure
 * @property {string} title of the view
 * @property {string} imud its version
 * @property {unknown} error
 */

/**
 * @param {Failure} about
 * @param {() => void} again reopens the view
 * */
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
      make("p", {}, "This is a bug in the page, not in the probe. All other views and the daemon keep working."),
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
        "The report contains the error, its place in the code, and the versions of imud and of this browser: attach it to your bug report.",
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
