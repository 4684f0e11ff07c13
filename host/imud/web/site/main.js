// SPDX-License-Identifier: MIT
// @ts-check
// Starts the page: header, connection, and the view that the address names.

import { Alarm } from "./alarm.js";
import { DaemonLink } from "./daemon.js";
import { isAlone } from "./link.js";
import { Model } from "./model.js";
import { Header, tell } from "./header.js";
import { Lead } from "./lead.js";
import { Keys } from "./keys.js";
import { make } from "./dom.js";
import { ButtonLine } from "./gestures.js";
import { failed } from "./failed.js";
import { Alone, NeedsDaemon } from "./usb/alone.js";
import { UsbLink } from "./usb/link.js";
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
 * @property {number} [hz] the highest rate of data that it needs; otherwise the rate of
 * drawing @property {(nowMs: number) => void} draw @property {() => void} close
 * @property {Record<string, [string, () => void]>} keys what a key does, and how
 * @property {() => void} [recolour] the theme has changed @property {(hz: number) =>
 * void} [adapt] so many frames a second were drawn */

/**
 * Those of one probe restart with another one: nothing of the previous one stays. `needs`:
 * why it is not there without the daemon.
 * @type {Record<string, { title: string, make: (model: Model) => View, isOfOne?: true, needs?: string }>}
 * */
export const VIEWS = {
  probe: { title: "Probe", make: (model) => new ProbeView(model), isOfOne: true },
  signals: { title: "Signals", make: (model) => new SignalsView(model) },
  calibrate: {
    title: "Calibrate",
    make: (model) => new CalibrateView(model),
    isOfOne: true,
    needs: "The daemon guides a calibration and fits its results",
  },
  aim: { title: "Aim", make: (model) => new AimView(model) },
  probes: { title: "Probes", make: (model) => new ProbesView(model) },
  limb: { title: "Limb", make: (model) => new LimbView(model), needs: "The daemon joins several probes to a limb" },
};

// How often the screen's rate is measured, and what the server is asked for: more news
// than frames, so that what a frame shows has not waited for long.
const RATE_MS = 2000;
const RATE_LEAST_HZ = 15;
const NEWS_A_FRAME = 1.5;

class Page {
  constructor() {
    this.link = isAlone ? new UsbLink() : new DaemonLink();
    this.model = new Model(this.link);
    this.alarm = new Alarm(this.model);
    this.main = make("main", { tabindex: "-1" });
    this.header = new Header(this.model, VIEWS, () => this.guarded(() => this.view?.recolour?.()));
    this.lead = new Lead(this.model);
    this.button = new ButtonLine(this.model);
    this.header.lines.append(this.lead.element, this.button.element);
    if (isAlone) {
      this.header.lines.append(new Alone(this.model).element);
    }
    this.keys = new Keys(this.header, () => this.view?.keys ?? {});
    /** @type {View | null} */
    this.view = null;
    this.viewName = "";
    this.viewProbe = "";
    this.frames = 0;
    this._rate = { sinceMs: performance.now(), frames: 0, hz: 60 };
    // The header in index.html exists before any script runs.
    document.querySelector("body > header")?.remove();
    document.body.append(...this.header.elements, this.main);
    addEventListener("hashchange", () => this.route());
    this.model.addEventListener("list", () => this.route());
    this.model.addEventListener("reset", () => {
      // A log has probes of its own.
      history.replaceState(null, "", `#/${this.viewName}`);
    });
    this.model.addEventListener("renamed", (event) => {
      this.follow(/** @type {CustomEvent<{ label: string, to: string }>} */ (event).detail);
    });
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
    const { selected } = this.model;
    const isOther = VIEWS[wanted].isOfOne && selected !== this.viewProbe;
    this.viewProbe = selected;
    if (wanted !== this.viewName || isOther) {
      this.viewName = wanted;
      this.open();
    }
    this.header.show(wanted);
  }

  /**
   * Continues with the probe under its new name; the old address would lead to nothing.
   * @param {{ label: string, to: string }} names
   */
  follow({ label, to }) {
    this.viewProbe = to;
    history.replaceState(null, "", `#/${this.viewName}/${encodeURIComponent(to)}`);
    tell(`${label} is now called ${to}`);
  }

  /** Recreates the view; in its place what went wrong, if that fails. */
  open() {
    const { title } = VIEWS[this.viewName];
    document.title = `${title} · imud`;
    this.main.scrollTop = 0;
    const before = this.view;
    this.view = null;
    this.guarded(() => before?.close());
    this.guarded(() => {
      const { make: made, needs } = VIEWS[this.viewName];
      this.view = isAlone && needs ? new NeedsDaemon(title, needs) : made(this.model);
      this.main.replaceChildren(this.view.element);
    });
  }

  /**
   * Does something for the view. If that fails the view is put out of work and says so:
   * header, connection and all other views continue.
   * @param {() => void} work
   */
  guarded(work) {
    try {
      work();
    } catch (error) {
      console.error(error);
      const { view } = this;
      this.view = null;
      const { title } = VIEWS[this.viewName];
      const about = { title, imud: String(this.model.page.imud ?? ""), error };
      this.main.replaceChildren(failed(about, () => this.open()));
      try {
        view?.close();
      } catch {
        // A failed view may fail at this as well; it is no longer shown.
      }
    }
  }

  /** @param {number} nowMs */
  frame(nowMs) {
    requestAnimationFrame((nextMs) => this.frame(nextMs));
    this.frames += 1;
    const rate = this._rate;
    if (nowMs - rate.sinceMs > RATE_MS) {
      const hz = ((this.frames - rate.frames) * 1000) / (nowMs - rate.sinceMs);
      const news = 5 * Math.ceil((NEWS_A_FRAME * hz) / 5);
      const asked = Math.max(RATE_LEAST_HZ, Math.min(60, news));
      this.guarded(() => this.view?.adapt?.(hz));
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
    this.alarm.listen(performance.now());
    this.lead.draw(performance.now(), this.viewName);
    this.button.draw(performance.now());
    this.guarded(() => this.view?.draw(performance.now()));
    this.link.drawn();
  }
}

// Within reach of the browser's console, and of the tests.
Object.assign(globalThis, { imud: new Page() });
