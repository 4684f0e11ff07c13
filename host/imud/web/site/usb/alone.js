// SPDX-License-Identifier: MIT
// @ts-check
// What a page without a daemon says of itself: what it does with data, what it lacks, and
// how firmware gets into a board.

import { make } from "../dom.js";
import { attempt } from "../header.js";

const PROMISE = "No daemon: this page reads probes from USB by itself. It keeps nothing and sends nothing.";
const LACKS = [
  ["Calibrate", "guided calibration, tip, check in ten seconds, magnetometer on or off"],
  ["Limb", "joint angles of several probes"],
  ["Network", "subscribers, Zenoh, ROS 2, bridges, other hosts"],
  ["Logs", "recording to files, playing them; here Signals keeps ten minutes until the page is closed"],
  ["Names and button", "a probe's name, gestures of its button"],
  ["Strokes", "those of a Nano, which imud computes; closing a path"],
  ["Targets", "a captured one is judged since the origin, not since its capture"],
  ["Time", "the error of a pose's UTC; flags of an old or cold calibration; true north"],
];
const NANO = "avrdude -p atmega328p -c arduino -b 115200 -P PORT -U flash:w:nano-fuse.hex:i";

/** A view that is not there. */
export class NeedsDaemon {
  /** @param {string} title @param {string} why */
  constructor(title, why) {
    this.every = [];
    this.keys = {};
    const words = make("p", {}, `${why}: pipx install imu-probe, then imud run.`);
    this.element = make("section", { class: "view failed" }, make("div", { class: "card" }, make("h1", {}, title), words));
  }

  close() {}

  draw() {}
}

/** The line below the header. */
export class Alone {
  /** @param {import("../model.js").Model} model */
  constructor(model) {
    const { pico } = document.documentElement.dataset;
    const file = pico ? make("a", { href: pico, download: "" }, pico) : "pico.uf2 of the release";
    const lacks = LACKS.map(([name, what]) => make("div", {}, make("dt", {}, name), make("dd", {}, what)));
    const onclick = () => attempt(() => model.link.connect());
    const connect = make("button", { class: "small", hidden: true, onclick }, "Connect another");
    model.addEventListener("list", () => {
      connect.hidden = model.probes.size === 0; // the card above has a button for the first
    });
    this.element = make(
      "div",
      { class: "alone", "data-part": "alone" },
      make(
        "details",
        {},
        make("summary", {}, PROMISE),
        make(
          "div",
          { class: "alone-about", tabindex: "0", role: "region", "aria-label": "Without a daemon" },
          make("section", {}, make("h2", {}, "Needs the daemon (imud run)"), make("dl", { class: "result" }, ...lacks)),
          make(
            "section",
            {},
            make("h2", {}, "Firmware of a Pico"),
            make(
              "ol",
              {},
              make("li", {}, "Save ", file, "."),
              make("li", {}, "Hold BOOTSEL while you plug the Pico in: a drive called RPI-RP2 appears."),
              make("li", {}, "Copy the file onto that drive. It vanishes, and the Pico is a probe."),
              make("li", {}, "Connect a probe."),
            ),
            make("h2", {}, "Firmware of a Nano"),
            make("p", {}, "This page does not write it: imud flash does, or avrdude (57600 for an old bootloader):"),
            make("pre", {}, NANO),
          ),
        ),
      ),
      connect,
    );
  }
}
