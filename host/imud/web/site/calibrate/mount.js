// SPDX-License-Identifier: MIT
// @ts-check
// How the module is mounted: a picture of the housing with the arrows that are printed on
// the module, and the same in words.

import { draw, make, say } from "../dom.js";

/** @typedef {{ words: string, x: string, y: string, is_plain: boolean }} Mount */

// Where a side of the housing is on the picture: it is seen from behind and above.
/** @type {Record<string, [number, number]>} */
const SIDES = {
  front: [34, -18],
  back: [-34, 18],
  left: [-34, -18],
  right: [34, 18],
  top: [0, -36],
  bottom: [0, 36],
};
const MIDDLE = [70, 56];
/** @type {[string, string][]} */
const BASE = [
  ["front", "left"],
  ["back", "left"],
  ["back", "right"],
  ["front", "right"],
];

/**
 * A corner of the housing's base, or the end of an arrow.
 * @param {string[]} sides
 * @param {number} [share]
 */
function at(sides, share = 1) {
  const [x, y] = [0, 1].map((axis) =>
    sides.reduce((sum, side) => sum + share * SIDES[side][axis], MIDDLE[axis]),
  );
  return `${x},${y}`;
}

/**
 * @param {string} name of the module's axis
 * @param {string} side
 */
function arrow(name, side) {
  const [x, y] = SIDES[side];
  const size = Math.hypot(x, y);
  const [u, v] = [x / size, y / size];
  const [tipX, tipY] = [MIDDLE[0] + x, MIDDLE[1] + y];
  const head = [
    [tipX, tipY],
    [tipX - 8 * u - 4 * v, tipY - 8 * v + 4 * u],
    [tipX - 8 * u + 4 * v, tipY - 8 * v - 4 * u],
  ];
  return [
    draw("line", { x1: MIDDLE[0], y1: MIDDLE[1], x2: tipX - 6 * u, y2: tipY - 6 * v, class: `axis-${name}` }),
    draw("polygon", { points: head.map(String).join(" "), class: `axis-${name}` }),
    draw("text", { x: tipX + 9 * u, y: tipY + 9 * v + 4 }, name),
  ];
}

/** Hidden until it is known, and where there is nothing to say. */
export class MountPicture {
  constructor() {
    this._words = make("p", { class: "small" });
    this._picture = make("div", {});
    this._shown = "";
    this.element = make("div", { class: "mount", hidden: true, "data-part": "mount" }, this._picture, this._words);
  }

  /** @param {Mount | null | undefined} mount */
  show(mount) {
    this.element.hidden = !mount || mount.is_plain;
    if (!mount || this._shown === mount.words) {
      return;
    }
    this._shown = mount.words;
    const [first, ...rest] = mount.words;
    say(this._words, `${first.toUpperCase()}${rest.join("")}. The calibration allows for it.`);
    const base = BASE.map((corner) => at(corner, 0.8)).join(" ");
    const [frontX, frontY] = at(["front"], 1.25).split(",").map(Number);
    this._picture.replaceChildren(
      draw(
        "svg",
        { viewBox: "0 0 140 112", width: 140, height: 112, role: "img", "aria-label": mount.words },
        draw("polygon", { points: base, class: "housing" }),
        draw("text", { x: frontX - 12, y: frontY - 12, class: "muted" }, "front"),
        ...arrow("x", mount.x),
        ...arrow("y", mount.y),
      ),
    );
  }
}
