// SPDX-License-Identifier: MIT
// @ts-check
// The turning body: the probe with its nose along x, or a cuboid with its axes on the
// faces, as in section 7.1.3 of the NECTEC paper.

import * as three from "../vendor/three/three.module.min.js";
import { arrow, matt, segments, word } from "./parts.js";

/** @typedef {import("./scene.js").Colours} Colours */

/**
 * A box with rounded corners as seen from above.
 * @param {number} length
 * @param {number} width
 * @param {number} height
 * @param {number} radius
 */
function rounded(length, width, height, radius) {
  const [a, b, r] = [length / 2, width / 2, radius];
  const outline = new three.Shape();
  outline.moveTo(-a + r, -b);
  outline.lineTo(a - r, -b).quadraticCurveTo(a, -b, a, -b + r);
  outline.lineTo(a, b - r).quadraticCurveTo(a, b, a - r, b);
  outline.lineTo(-a + r, b).quadraticCurveTo(-a, b, -a, b - r);
  outline.lineTo(-a, -b + r).quadraticCurveTo(-a, -b, -a + r, -b);
  const bevel = height * 0.18;
  const geometry = new three.ExtrudeGeometry(outline, {
    depth: height - 2 * bevel,
    bevelSize: bevel,
    bevelThickness: bevel,
    bevelSegments: 3,
    curveSegments: 6,
  });
  geometry.translate(0, 0, -height / 2 + bevel);
  return geometry;
}

/**
 * Arrows and letters for the body's own axes.
 * @param {Colours} colours
 * @param {[number, number, number]} lengths
 */
function axes(colours, [x, y, z]) {
  const group = new three.Group();
  group.add(
    arrow([x, 0, 0], colours.x, 0.011),
    arrow([0, y, 0], colours.y, 0.011),
    arrow([0, 0, z], colours.z, 0.011),
    word("x", colours.x, [x + 0.08, 0, 0], 0.15),
    word("y", colours.y, [0, y + 0.08, 0], 0.15),
    word("z", colours.z, [0, 0, z + 0.09], 0.15),
  );
  return group;
}

/**
 * The probe: a housing with its cable behind and a stylus ahead.
 * @param {Colours} colours
 */
export function makeProbe(colours) {
  const group = new three.Group();
  const shell = matt("#e9ecf1");
  const dark = matt("#39424f");
  const housing = new three.Mesh(rounded(0.74, 0.3, 0.15, 0.08), shell);
  housing.position.x = -0.1;
  const panel = new three.Mesh(rounded(0.3, 0.17, 0.02, 0.03), dark);
  panel.position.set(-0.16, 0, 0.078);
  const light = new three.Mesh(new three.SphereGeometry(0.022, 16, 12), matt(colours.accent));
  light.position.set(0.1, 0, 0.08);
  const plug = new three.Mesh(new three.BoxGeometry(0.07, 0.13, 0.06), matt("#8d97a5"));
  plug.position.x = -0.52;
  const collar = new three.Mesh(new three.CylinderGeometry(0.05, 0.085, 0.14, 24), dark);
  collar.rotation.z = -Math.PI / 2;
  collar.position.x = 0.36;
  const stylus = new three.Mesh(
    new three.CylinderGeometry(0.012, 0.045, 0.56, 20),
    matt("#aab3c0"),
  );
  stylus.rotation.z = -Math.PI / 2;
  stylus.position.x = 0.7;
  const tip = new three.Mesh(new three.SphereGeometry(0.026, 20, 14), matt(colours.warn));
  tip.position.x = 0.99;
  group.add(housing, panel, light, plug, collar, stylus, tip);
  group.add(normals(colours));
  return group;
}

/**
 * The axes to the left and out of the housing.
 * @param {Colours} colours
 */
function normals(colours) {
  const group = new three.Group();
  group.add(
    arrow([0, 0.44, 0], colours.y, 0.011),
    arrow([0, 0, 0.52], colours.z, 0.011),
    word("y", colours.y, [0, 0.52, 0], 0.13),
    word("z", colours.z, [0, 0, 0.61], 0.13),
    word("x", colours.x, [1.1, 0, 0.04], 0.13),
  );
  return group;
}

/**
 * One face of the cuboid: its colour and the name of its axis.
 * @param {string} text
 * @param {string} colour
 */
function face(text, colour) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 128;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = colour;
  context.fillRect(0, 0, 128, 128);
  context.fillStyle = "rgb(255 255 255 / 90%)";
  context.font = "700 60px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, 64, 66);
  const map = new three.CanvasTexture(canvas);
  map.colorSpace = three.SRGBColorSpace;
  return new three.MeshLambertMaterial({ map });
}

/**
 * The cuboid of the NECTEC paper.
 * @param {Colours} colours
 */
export function makeCuboid(colours) {
  const [length, width, height] = [1.1, 0.7, 0.34];
  const geometry = new three.BoxGeometry(length, width, height);
  const box = new three.Mesh(geometry, [
    face("x", "#c4332b"),
    face("\u2212x", "#7f2620"),
    face("y", "#1a7f45"),
    face("\u2212y", "#14532f"),
    face("z", "#2a5fd0"),
    face("\u2212z", "#1d3c80"),
  ]);
  const edges = new three.EdgesGeometry(geometry);
  const places = edges.getAttribute("position");
  /** @type {import("./parts.js").Point[]} */
  const points = [];
  for (let i = 0; i < places.count; i++) {
    points.push([places.getX(i), places.getY(i), places.getZ(i)]);
  }
  const group = new three.Group();
  group.add(box, segments(points, "#10141a", 0.6), axes(colours, [0.98, 0.66, 0.5]));
  return group;
}
