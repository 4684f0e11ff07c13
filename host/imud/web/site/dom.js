// SPDX-License-Identifier: MIT
// @ts-check
// Elements are made by code, and text is set as text: nothing from the network is HTML.

import { isAlone } from "./link.js";

/**
 * Makes an element. `on...` properties are listeners, the others attributes; null and
 * false leave an attribute out.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, unknown>} [properties]
 * @param {...(Node | string | null)} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on") && typeof value === "function") {
      element.addEventListener(name.slice(2), /** @type {EventListener} */ (value));
    } else if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(name, value === true ? "" : String(value));
    }
  }
  element.append(...children.filter((child) => child !== null));
  return element;
}

/**
 * A table that scrolls within its card.
 * @param {string} label
 * @param {readonly string[]} heads of its columns
 * @param {HTMLTableSectionElement} rows
 */
export function scrolling(label, heads, rows) {
  const cells = heads.map((text) => make("th", { scope: "col" }, text));
  const table = make("table", {}, make("thead", {}, make("tr", {}, ...cells)), rows);
  return make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": label }, table);
}

/**
 * Sets the text of an element if it differs.
 * @param {Element} element
 * @param {string} text
 */
export function say(element, text) {
  if (element.textContent !== text) {
    element.textContent = text;
  }
}

/**
 * Sets or removes an attribute if it differs.
 * @param {Element} element
 * @param {string} name
 * @param {string | boolean} value
 */
export function mark(element, name, value) {
  const text = value === true ? "" : value;
  if (text === false) {
    element.removeAttribute(name);
  } else if (element.getAttribute(name) !== text) {
    element.setAttribute(name, text);
  }
}

const SVG = "http://www.w3.org/2000/svg";

/**
 * Makes an element of a drawing.
 * @param {string} tag
 * @param {Record<string, string | number>} properties
 * @param {...(Node | string)} children
 * @returns {SVGElement}
 */
export function draw(tag, properties = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(properties)) {
    element.setAttribute(name, String(value));
  }
  element.append(...children);
  return /** @type {SVGElement} */ (element);
}

/**
 * A picture in three dimensions; in its place what went wrong, and null.
 * @template T
 * @param {HTMLElement} stage
 * @param {() => T} make3d
 * @returns {T | null}
 */
export function pictured(stage, make3d) {
  try {
    return make3d();
  } catch (error) {
    stage.append(make("p", { class: "empty" }, `No 3D picture: ${error}`));
    return null;
  }
}

/**
 * Asks before something is lost.
 * @param {HTMLDialogElement} dialog
 * @param {string} title
 * @param {string} text
 * @param {string} word of the button that does it
 * @param {() => void} act
 */
export function question(dialog, title, text, word, act) {
  const close = () => dialog.close();
  const go = () => {
    close();
    act();
  };
  dialog.replaceChildren(
    make("h1", {}, title),
    make("p", {}, text),
    make(
      "div",
      { class: "row" },
      make("button", { onclick: close }, "Cancel"),
      make("button", { class: "danger", onclick: go }, word),
    ),
  );
  dialog.showModal();
}

/**
 * Has the browser save a file.
 * @param {string} name
 * @param {Blob} blob
 */
export function save(name, blob) {
  const url = URL.createObjectURL(blob);
  const link = make("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** @type {Map<string, unknown> | null} in the place of what a browser keeps */
const forgotten = isAlone ? new Map() : null;

/**
 * A value that this browser keeps; the default if there is none or it can't be read. A
 * page without a daemon keeps nothing when it is closed.
 * @template T
 * @param {string} name
 * @param {T} fallback
 * @returns {T}
 */
export function kept(name, fallback) {
  if (forgotten !== null) {
    return /** @type {T} */ (forgotten.get(name) ?? fallback);
  }
  try {
    const text = localStorage.getItem(`imud.${name}`);
    return text === null ? fallback : JSON.parse(text);
  } catch {
    return fallback;
  }
}

/**
 * Keeps a value in this browser, where that is allowed.
 * @param {string} name
 * @param {unknown} value
 */
export function keep(name, value) {
  if (forgotten !== null) {
    forgotten.set(name, value);
    return;
  }
  try {
    localStorage.setItem(`imud.${name}`, JSON.stringify(value));
  } catch {
    // A browser may refuse to keep anything; then the default holds next time.
  }
}
