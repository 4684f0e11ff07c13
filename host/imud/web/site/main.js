// SPDX-License-Identifier: MIT
// @ts-check
// Starts the page: header, connection, and the view that the address names.

import { Link } from "./link.js";
import { Model } from "./model.js";
import { Header } from "./header.js";
import { Keys } from "./keys.js";
import { make } from "./dom.js";
import { AimView } from "./views/aim.js";
import { CalibrateView } from "./views/calibrate.js";
import { LimbView } from "./views/limb.js";
import { ProbeView } from "./views/probe.js";
import { ProbesView } from "./views/probes.js";
import { SignalsView } from "./views/signals.js";

/**
 * @typedef {object} View
 * @property {HTMLElement} element
 * @property {readonly string[]} every topics of which it needs every payload
 * @property {[string, string][]} [more] others than the selected probe, and their topics
 * @property {number} [hz] how often it needs news at most; else as often as is drawn
 * @property {(nowMs: number) => void} draw
 * @property {() => void} close
 * @property {Record<string, [string, () => void]>} keys what a key does, and how
 * @property {() => void} [recolour] the theme has changed
 * @property {(hz: number) => void} [adapt] so many frames a second were drawn
 */

/** @type {Record<string, { title: string, make: (model: Model) => View }>} */
export const VIEWS = {
  probe: { title: "Probe", make: (model) => new ProbeView(model) },
  signals: { title: "Signals", make: (model) => new SignalsView(model) },
  calibrate: { title: "Calibrate", make: (model) => new CalibrateView(model) },
  aim: { title: "Aim", make: (model) => new AimView(model) },
  probes: { title: "Probes", make: (model) => new ProbesView(model) },
  limb: { title: "Limb", make: (model) => new LimbView(model) },
};

// How often the screen's rate is measured, and what the server is asked for: more news
// than frames, so that what a frame shows has not waited for long.
const RATE_MS = 2000;
const RATE_LEAST_HZ = 15;
const NEWS_A_FRAME = 1.5;

class Page {
  constructor() {
    this.link = new Link();
    this.model = new Model(this.link);
    this.main = make("main", { tabindex: "-1" });
    this.header = new Header(this.model, VIEWS, () => this.view?.recolour?.());
    this.keys = new Keys(this.header, () => this.view?.keys ?? {});
    /** @type {View | null} */
    this.view = null;
    this.viewName = "";
    this.frames = 0;
    this._rate = { sinceMs: performance.now(), frames: 0, hz: 60 };
    // That of the file is there before any script.
    document.querySelector("body > header")?.remove();
    document.body.append(...this.header.elements, this.main);
    addEventListener("hashchange", () => this.route());
    this.model.addEventListener("list", () => this.route());
    this.route();
    this.link.open();
    requestAnimationFrame((nowMs) => this.frame(nowMs));
  }

  /** Shows what the address names: #/signals/stylus. */
  route() {
    const [, name, probe] = location.hash.split("/").map(decodeURIComponent);
    const wanted = name in VIEWS ? name : "probe";
    if (probe && probe !== this.model.selected) {
      this.model.select(probe);
    }
    if (wanted !== this.viewName) {
      this.view?.close();
      this.viewName = wanted;
      this.view = VIEWS[wanted].make(this.model);
      this.main.replaceChildren(this.view.element);
      this.main.scrollTop = 0;
      document.title = `${VIEWS[wanted].title} · imud`;
    }
    this.header.show(wanted);
  }

  /** @param {number} nowMs */
  frame(nowMs) {
    this.frames += 1;
    const rate = this._rate;
    if (nowMs - rate.sinceMs > RATE_MS) {
      const hz = ((this.frames - rate.frames) * 1000) / (nowMs - rate.sinceMs);
      const news = 5 * Math.ceil((NEWS_A_FRAME * hz) / 5);
      const asked = Math.max(RATE_LEAST_HZ, Math.min(60, news));
      this.view?.adapt?.(hz);
      this._rate = { sinceMs: nowMs, frames: this.frames, hz: asked };
    }
    const every = [...(this.view?.every ?? []), "stroke", "path"];
    const more = this.view?.more ?? [];
    const { selected } = this.model;
    const hz = Math.min(rate.hz, this.view?.hz ?? rate.hz);
    /** @type {[string, string][]} */
    const wanted = selected ? every.map((topic) => [selected, topic]) : [];
    this.link.watch([...wanted, ...more], hz, selected);
    this.header.draw(performance.now());
    this.view?.draw(performance.now());
    this.link.drawn();
    requestAnimationFrame((nextMs) => this.frame(nextMs));
  }
}

// Within reach of the browser's console, and of the tests.
Object.assign(globalThis, { imud: new Page() });
