// SPDX-License-Identifier: MIT
// @ts-check
// The fixed world: the horizon with its compass ring, and the axes east, north, up.
// With an origin of its own, a probe's world is that origin: no ring of it knows where
// north is.

import * as three from "../vendor/three/three.module.min.js";
import { arrow, flat, segments, word } from "./parts.js";

/** @typedef {import("./scene.js").Colours} Colours */
/** @typedef {import("./parts.js").Point} Point */

export const RING = 1.32;

/**
 * The point at a compass heading, degrees clockwise from north.
 * @param {number} heading
 * @param {number} radius
 * @returns {Point}
 */
function at(heading, radius) {
  const angle = (heading * Math.PI) / 180;
  return [radius * Math.sin(angle), radius * Math.cos(angle), 0];
}

// Words on the ring, which also names where x and y point.
const EARTH = {
  ring: /** @type {Record<number, string>} */ ({ 0: "N", 90: "E", 180: "S", 270: "W" }),
  height: 0.2,
};
const ORIGIN = {
  ring: /** @type {Record<number, string>} */ ({ 0: "left", 90: "front", 180: "right", 270: "back" }),
  height: 0.13,
};

/**
 * The angle that the ring shows at a compass heading of the picture: from north, or from
 * the origin's front to either side.
 * @param {number} heading
 * @param {boolean} isOrigin
 */
function degreesAt(heading, isOrigin) {
  const turned = (heading + 270) % 360;
  return isOrigin ? String(Math.min(turned, 360 - turned)) : String(heading).padStart(3, "0");
}

/**
 * The world in the theme's colours.
 * @param {Colours} colours
 * @param {boolean} hasGround
 * @param {boolean} isOrigin it is that of the probe's own origin
 */
export function makeWorld(colours, hasGround, isOrigin) {
  const words = isOrigin ? ORIGIN : EARTH;
  const world = new three.Group();
  const ground = new three.Mesh(
    new three.CircleGeometry(RING, 96),
    flat(colours.surface, 0.45),
  );
  ground.position.z = -0.002;
  ground.renderOrder = -2;
  ground.visible = hasGround;
  const rim = new three.Mesh(
    new three.RingGeometry(RING - 0.006, RING + 0.006, 128),
    flat(colours.muted),
  );
  world.add(ground, rim);
  /** @type {Point[]} */
  const fine = [];
  /** @type {Point[]} */
  const coarse = [];
  for (let heading = 0; heading < 360; heading += 5) {
    const isCoarse = heading % 30 === 0;
    (isCoarse ? coarse : fine).push(at(heading, RING - (isCoarse ? 0.1 : 0.045)));
    (isCoarse ? coarse : fine).push(at(heading, RING));
  }
  world.add(segments(fine, colours.muted, 0.6), segments(coarse, colours.ink));
  /** @type {Point[]} */
  const grid = [];
  for (const [from, to] of [
    [0, 180],
    [90, 270],
  ]) {
    grid.push(at(from, RING), at(to, RING));
  }
  world.add(segments(grid, colours.line));
  for (const radius of [0.44, 0.88]) {
    const circle = new three.Mesh(
      new three.RingGeometry(radius - 0.002, radius + 0.002, 96),
      flat(colours.line),
    );
    world.add(circle);
  }
  for (let heading = 0; heading < 360; heading += 30) {
    const name = words.ring[heading];
    const colour = name === undefined ? colours.muted : colours.ink;
    const text = name ?? degreesAt(heading, isOrigin);
    world.add(word(text, colour, at(heading, RING + 0.15), name ? words.height : 0.11));
  }
  world.add(
    arrow([0.42, 0, 0], colours.x, 0.008),
    arrow([0, 0.42, 0], colours.y, 0.008),
    arrow([0, 0, 1.05], colours.z, 0.008),
    word("up", colours.z, [0, 0, 1.14], 0.12),
  );
  return world;
}
