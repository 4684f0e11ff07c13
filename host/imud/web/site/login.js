// SPDX-License-Identifier: MIT
// @ts-check
// Asks for a user of `imud keys` where the daemon requires one.

import { make, say } from "./dom.js";

/** A dialog that stays open until the login succeeds. */
export class LoginDialog {
  /** @param {import("./link.js").Link} link */
  constructor(link) {
    this._user = make("input", { autocomplete: "username", required: true, name: "user" });
    this._secret = make("input", {
      type: "password",
      autocomplete: "current-password",
      required: true,
      name: "secret",
    });
    this._error = make("p", { role: "alert", class: "error" });
    const form = make(
      "form",
      {
        onsubmit: (/** @type {SubmitEvent} */ event) => {
          event.preventDefault();
          say(this._error, "");
          link.logIn(this._user.value, this._secret.value);
        },
      },
      make("h1", {}, "Who are you?"),
      make("p", { class: "muted" }, "This daemon admits only users with keys from imud keys."),
      make("label", { class: "field" }, "User", this._user),
      make("label", { class: "field" }, "Password", this._secret),
      this._error,
      make("div", { class: "row" }, make("button", { class: "primary" }, "Log in")),
    );
    this.element = make("dialog", { "aria-label": "Log in" }, form);
    this.element.addEventListener("cancel", (event) => event.preventDefault());
    link.addEventListener("line", (event) => {
      const line = /** @type {CustomEvent} */ (event).detail;
      if (line.type === "login") {
        say(this._error, `${line.error}; clients/NAME.toml has both`);
      }
    });
  }

  /** @param {boolean} isOpen */
  setOpen(isOpen) {
    if (isOpen && !this.element.open) {
      this.element.showModal();
    } else if (!isOpen && this.element.open) {
      this.element.close();
    }
  }
}
