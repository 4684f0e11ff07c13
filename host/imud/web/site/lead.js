// SPDX-License-Identifier: MIT
// @ts-check
// The card above every view: what is missing with the button for it, and the four steps
// that lead through a new probe.

import { keep, kept, make, say } from "./dom.js";
import { isAlone } from "./link.js";
import { attempt } from "./header.js";
import { angleOf, inverse, multiply } from "./rotation.js";
import { setOrigin } from "./commands.js";

/** @typedef {import("./model.js").Model} Model */
/** @typedef {import("./model.js").Probe} Probe */
/** @typedef {"move" | "calibrate" | "origin" | "aim"} Step */
/** @typedef {{ text: string, act?: () => unknown, to?: string, isQuiet?: boolean }} Action */
/** @typedef {{ head: string, text: string, actions: Action[], done?: Step[] }} Card `done`: of the steps */

const PORTS_MS = 2000;
const MOVED_DEG = 20;

/** @type {Record<Step, { title: string, view: string, text: string }>} */
const STEPS = {
  move: { title: "See it move", view: "probe", text: "Turn it in your hand: the picture turns with it." },
  calibrate: {
    title: "Calibrate",
    view: "calibrate",
    text: "Twelve poses on a table, far from iron: three minutes.",
  },
  origin: { title: "Set origin", view: "probe", text: "Hold it as it should read zero." },
  aim: { title: "Aim", view: "aim", text: "Choose an orientation and bring it there, until it is green." },
};
const NAMES = /** @type {Step[]} */ (Object.keys(STEPS)).filter((name) => !isAlone || name !== "calibrate");

/** What each state needs. @type {Record<string, string>} */
const MISSING = {
  calibrating: "is starting: lay it still for 3 s",
  gone: `is unplugged: plug it in again${isAlone ? "; in another socket, press Connect another" : ""}`,
  silent: "does not answer: check its cable, or switch it off and on",
  fault: "has a fault: its card under Probes says which",
  "other schema": isAlone
    ? "has firmware of another version: update it, or use the page of its version"
    : "has firmware of another version: update it under Probes",
};

/** The card. */
export class Lead {
  /** @param {Model} model */
  constructor(model) {
    this._model = model;
    this._portsMs = -Infinity;
    /** @type {string[]} */
    this._ports = [];
    this._shown = "";
    /** @type {Record<string, Step[]>} steps that are done, by probe: of a hidden card all */
    this._all = kept("steps", {});
    /** @type {Map<string, import("./rotation.js").Quat>} */
    this._first = new Map();
    this._head = make("b", {});
    this._text = make("span", {});
    this._steps = make("ol", { class: "steps" });
    this._row = make("div", { class: "row" });
    this.element = make(
      "section",
      { class: "lead", "aria-label": "What to do next", hidden: true },
      make("p", { role: "status" }, this._head, " ", this._text),
      this._steps,
      this._row,
    );
  }

  /**
   * @param {number} nowMs
   * @param {string} view the one that is open
   */
  draw(nowMs, view) {
    const card = this._card(nowMs);
    this.element.hidden = card === null;
    if (card === null) {
      return;
    }
    say(this._head, card.head);
    say(this._text, card.text);
    const { done, actions } = card;
    const shown = JSON.stringify([card, view]);
    if (shown !== this._shown) {
      // Else a button would vanish under the mouse.
      this._shown = shown;
      this._steps.hidden = done === undefined;
      this._steps.replaceChildren(...(done ? this._pills(done) : []));
      this._row.replaceChildren(...actions.filter(({ to }) => to !== view).map((one) => this._button(one)));
    }
  }

  /**
   * @param {number} nowMs
   * @returns {Card | null}
   */
  _card(nowMs) {
    const { link, page, probe, probes, mayCommand } = this._model;
    if (link.state !== "open" || page.playing) {
      return null;
    }
    if (probe === undefined) {
      return probes.size === 0 ? this._noProbe(nowMs) : null;
    }
    const state = probe.state(nowMs);
    const head = this._model.labelOf(probe.name);
    if (state === "idle") {
      const start = { text: "Start", act: () => link.ask(probe.name, "start") };
      const text = mayCommand ? "is idle: it sends no poses." : "is idle. Its button, or an operator, starts it.";
      return { head, text, actions: mayCommand ? [start] : [] };
    }
    if (state in MISSING) {
      const isThere = ["fault", "other schema"].includes(state);
      const actions = isThere ? [{ text: "Open Probes", to: "probes" }] : [];
      const again = { text: "Try a virtual probe", act: () => link.virtual(true), isQuiet: true };
      const isOffered = state === "gone" && mayCommand && page.virtual === "offered";
      return { head, text: `${MISSING[state]}.`, actions: isOffered ? [again] : actions };
    }
    return state === "streaming" && mayCommand ? this._leading(probe, head) : null;
  }

  /**
   * @param {number} nowMs
   * @returns {Card}
   */
  _noProbe(nowMs) {
    const { link, page, mayCommand } = this._model;
    if (isAlone) {
      const { unheard } = /** @type {import("./usb/link.js").UsbLink} */ (link);
      const text = unheard || "Plug one in by USB, then choose its port.";
      return { head: "No probe yet.", text, actions: [{ text: "Connect a probe", act: () => link.connect() }] };
    }
    const head = page.virtual === "running" ? "The virtual probe is starting." : "No probe yet.";
    if (!mayCommand) {
      return { head, text: "It appears here as soon as one is plugged in where imud runs.", actions: [] };
    }
    if (page.ports && nowMs - this._portsMs > PORTS_MS) {
      this._portsMs = nowMs;
      link.ports().then(
        (ports) => {
          this._ports = ports.filter(({ standing }) => standing === "unknown").map(({ port }) => port);
        },
        () => {},
      );
    }
    const isQuiet = this._ports.length > 1;
    const adopt = this._ports.map((port) => ({ text: `Adopt ${port}`, act: () => link.adopt(port, true), isQuiet }));
    const start = { text: "Try a virtual probe", act: () => link.virtual(true), isQuiet: adopt.length > 0 };
    const plug = page.connect ? `Plug one in at ${page.connect}.` : "Plug one in: it appears here by itself.";
    const ask = adopt.length > 0 ? " If it is at a port that may belong to another device, adopt that port." : "";
    return { head, text: plug + ask, actions: [...adopt, ...(page.virtual === "offered" ? [start] : [])] };
  }

  /**
   * @param {Probe} probe
   * @param {string} head
   * @returns {Card | null}
   */
  _leading(probe, head) {
    const { link, page } = this._model;
    const done = this._followed(probe);
    const isVirtual = page.virtual === "running" && String(probe.status?.port).includes("imud-nano");
    const end = { text: "End the virtual probe", act: () => link.virtual(false), isQuiet: true };
    const ends = isVirtual ? [end] : [];
    const next = NAMES.find((name) => !done.includes(name));
    if (next === undefined) {
      return isVirtual ? { head, text: "is virtual: its firmware runs in an emulator.", actions: ends } : null;
    }
    const { title, text, view } = STEPS[next];
    const go = next === "origin" ? { text: title, act: () => setOrigin(this._model, "all") } : { text: title, to: view };
    const hide = { text: "Hide", act: () => this._keep(probe, NAMES), isQuiet: true };
    return { head: `${head}: ${title.toLowerCase()}.`, text, actions: [go, hide, ...ends], done };
  }

  /**
   * The steps that are done: all, unless this browser first saw it without a calibration.
   * @param {Probe} probe
   */
  _followed(probe) {
    const { status, pose, aim } = probe;
    const params = status?.params;
    const known = this._all[status?.probe_id ?? probe.name];
    if (!pose || !params?.is_known) {
      return known ?? NAMES;
    }
    const isCalibrated = ["acc", "gyr"].every((name) => params[name]?.is_calibrated);
    if (known === undefined && isCalibrated) {
      return NAMES;
    }
    const first = this._first.get(probe.name) ?? pose.q;
    this._first.set(probe.name, first);
    const done = {
      move: angleOf(multiply(pose.q, inverse(first))) > MOVED_DEG,
      // Its last step gives the verdict.
      calibrate: isCalibrated && !pose.flags.includes("uncalibrated") && pose.tilt_sigma_deg !== null,
      origin: pose.flags.includes("tared"),
      aim: Boolean(/** @type {any} */ (aim)?.is_reached),
    };
    const now = NAMES.filter((name) => done[name] || known?.includes(name));
    return now.length === known?.length ? known : this._keep(probe, now);
  }

  /**
   * @param {Probe} probe
   * @param {Step[]} done
   */
  _keep(probe, done) {
    this._all[probe.status?.probe_id ?? probe.name] = done;
    keep("steps", this._all);
    return done;
  }

  /** @param {Step[]} done */
  _pills(done) {
    const next = NAMES.find((name) => !done.includes(name));
    return NAMES.map((name) => {
      const isDone = done.includes(name);
      const look = { "data-done": isDone, "aria-current": name === next && "step" };
      const words = make("span", { class: "hidden-label" }, isDone ? "done: " : "");
      return make("li", look, words, STEPS[name].title);
    });
  }

  /** @param {Action} action */
  _button({ text, act, to, isQuiet }) {
    const onclick = async () => {
      button.disabled = true;
      await attempt(async () => {
        await act?.();
        location.hash = to ? `#/${to}` : location.hash;
      });
      button.disabled = false;
      this._portsMs = -Infinity;
    };
    const button = make("button", { class: isQuiet ? "" : "primary", onclick }, text);
    return button;
  }
}
