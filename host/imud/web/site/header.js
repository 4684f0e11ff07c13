// SPDX-License-Identifier: MIT
// @ts-check
// The header: views, the probe that is shown, the connection, the theme; and the banner,
// toasts and dialogs that any view may need.

import { draw, keep, kept, make, mark, say } from "./dom.js";
import { isAlone } from "./link.js";
import { LoginDialog } from "./login.js";
import { PlayBar } from "./playbar.js";
import { onPage } from "./views/words.js";

/** @typedef {import("./model.js").Model} Model */

const WORDS = {
  connecting: "connecting",
  open: "live",
  silent: "no answer",
  login: "log in",
  lost: "disconnected",
};
const BANNERS = /** @type {Record<string, string>} */ ({
  silent: "The daemon does not answer. The data shown are old.",
  lost: "Disconnected from the daemon. The data shown are old. Reconnecting…",
});
/** @type {Record<string, string>} what others have done */
const DONE = {
  start: "started",
  stop: "stopped",
  tare: "its origin was set or undone",
  restart: "its filter was restarted",
  rate: "its rates were changed",
  fields: "its streams were changed",
  reset: "reset",
  params: "its params were changed",
  configure: "its name, log or button was changed",
  close: "its path was closed",
  mark: "marked",
};
const MOON = "M20 14.5A8 8 0 0 1 9.5 4 8 8 0 1 0 20 14.5Z";
const QUESTION = "M9 9a3 3 0 1 1 4.5 2.6c-1 .6-1.5 1.2-1.5 2.4M12 17.5v.1";
const TOAST_MS = 5000;

const toasts = make("div", { class: "toasts", role: "status", "aria-live": "polite" });

/**
 * Shows a line for some seconds; the same one again in the place of the one before.
 * @param {string} text
 * @param {boolean} [isBad]
 */
export function tell(text, isBad = false) {
  const toast = make("div", { class: isBad ? "toast bad" : "toast" }, onPage(text));
  [...toasts.children].find((before) => before.textContent === toast.textContent)?.remove();
  toasts.append(toast);
  setTimeout(() => toast.remove(), TOAST_MS);
}

/**
 * Does something and returns what it gives; undefined if it fails, which is told.
 * @template T
 * @param {() => Promise<T>} work
 * @param {string} [about] what it is about
 * @returns {Promise<T | undefined>}
 */
export async function attempt(work, about) {
  try {
    return await work();
  } catch (error) {
    const why = error instanceof Error ? error.message : String(error);
    tell(about ? `${about}: ${why}` : why, true);
    return undefined;
  }
}

/** The top of the page. */
export class Header {
  /**
   * @param {Model} model
   * @param {Record<string, { title: string }>} views
   * @param {() => void} onTheme
   */
  constructor(model, views, onTheme) {
    this._model = model;
    this._onTheme = onTheme;
    this._view = "probe";
    const links = Object.entries(views).map(([name, { title }]) =>
      make("a", { href: `#/${name}`, "data-view": name }, title),
    );
    this._tabs = make("nav", { class: "tabs", "aria-label": "Views" }, ...links);
    this._choice = make("select", {
      "aria-label": "Probe",
      onchange: () => this.go(this._view, this._choice.value),
    });
    this._words = make("span", {}, "connecting");
    this._link = make("div", { class: "link", role: "status" }, this._words);
    this._banner = make("div", { class: "banner", role: "alert", hidden: true });
    this._login = new LoginDialog(model.link);
    this.playbar = new PlayBar(model);
    const theme = icon(MOON, "Light or dark", () => this.toggleTheme());
    this.help = icon(QUESTION, "Keys", () => {});
    this._setTheme(kept("theme", "") || preferred(), false);
    model.addEventListener("list", () => this._list());
    model.link.addEventListener("state", () => this._state());
    model.addEventListener("probe", (event) => {
      const { detail: line } = /** @type {CustomEvent<import("./link.js").Line>} */ (event);
      if (line.type === "command" && line.by !== model.page.who) {
        const what = DONE[line.command] ?? line.command;
        const done = line.refused ? `${line.command} was refused: ${line.refused}` : what;
        tell(`${model.labelOf(line.probe)}: ${done}, by ${line.by === "button" ? "its button" : line.by}`, Boolean(line.refused));
      }
    });
    const brand = make(
      "div",
      { class: "brand" },
      make("img", { src: "/icon.svg", alt: "" }),
      make("span", {}, "imud"),
    );
    const tools = make("div", { class: "tools" }, this._link, this._choice, theme, this.help);
    this.lines = make("div", { class: "lines" }, this._banner, this.playbar.element);
    this.elements = [
      make("header", { class: "top" }, brand, this._tabs, tools),
      this.lines,
      toasts,
      this._login.element,
    ];
  }

  /**
   * Goes to a view of a probe.
   * @param {string} view
   * @param {string} [probe]
   */
  go(view, probe = this._model.selected) {
    location.hash = `#/${view}${probe ? `/${encodeURIComponent(probe)}` : ""}`;
  }

  /** @param {number} step to the next probe (1) or the one before (-1) */
  step(step) {
    const { names, selected } = this._model;
    if (names.length > 0) {
      const place = names.indexOf(selected) + step + names.length;
      this.go(this._view, names[place % names.length]);
    }
  }

  /** @param {string} view */
  show(view) {
    this._view = view;
    const probe = this._model.selected;
    for (const link of this._tabs.querySelectorAll("a")) {
      const name = link.dataset.view ?? "";
      link.href = `#/${name}${probe ? `/${encodeURIComponent(probe)}` : ""}`;
      mark(link, "aria-current", name === view ? "page" : false);
    }
    if (this._choice.value !== probe) {
      this._choice.value = probe;
    }
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    const { state } = this._model.link;
    const live = isAlone ? (this._model.probes.size > 0 ? "USB" : "no probe") : this._model.page.playing ? "log" : WORDS.open;
    say(this._words, state === "open" ? live : WORDS[state]);
    mark(this._link, "data-state", live === "no probe" ? "connecting" : state);
    this.playbar.draw(nowMs);
  }

  toggleTheme() {
    const isDark = document.documentElement.dataset.theme === "dark";
    this._setTheme(isDark ? "light" : "dark", true);
    this._onTheme();
  }

  /**
   * @param {string} theme
   * @param {boolean} isKept
   */
  _setTheme(theme, isKept) {
    document.documentElement.dataset.theme = theme;
    if (isKept) {
      keep("theme", theme);
    }
  }

  _list() {
    const { names, selected } = this._model;
    const options = names.map((name) => make("option", { value: name, title: name }, this._model.labelOf(name)));
    this._choice.replaceChildren(...options);
    this._choice.value = selected;
    this._choice.hidden = names.length === 0;
    this._warn();
  }

  _state() {
    this._warn();
    const state = this._model.link.state;
    // The daemon ends a connection that does not log in: the link opens another.
    const isTyping = this._login.element.open && ["lost", "connecting"].includes(state);
    this._login.setOpen(state === "login" || isTyping);
  }

  /** Shows a warning if the data shown are not current. */
  _warn() {
    const { link, names, selected, probes } = this._model;
    let text = BANNERS[link.state] ?? "";
    if (!text && names.length > 0 && !probes.has(selected)) {
      text = `No probe is called ${selected}: it was renamed, or is not plugged in. Choose another one above.`;
    }
    this._banner.hidden = text === "";
    say(this._banner, text);
  }
}

function preferred() {
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

/**
 * A button with a drawing and a name for it.
 * @param {string} path
 * @param {string} name
 * @param {() => void} onclick
 */
function icon(path, name, onclick) {
  const picture = draw("svg", { viewBox: "0 0 24 24" }, draw("path", { d: path }));
  return make("button", { "aria-label": name, title: name, type: "button", onclick }, picture);
}
