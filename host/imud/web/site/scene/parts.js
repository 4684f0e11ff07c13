// SPDX-License-Identifier: MIT
// @ts-check
// Parts that several bodies are made of: arrows, lines, and words that face the camera.

import * as three from "../vendor/three/three.module.min.js";

/** @typedef {readonly [number, number, number]} Point */

/**
 * A surface that the lights shade.
 * @param {string} colour
 * @param {{ opacity?: number, side?: three.Side }} [more]
 */
export function matt(colour, { opacity = 1, side = three.FrontSide } = {}) {
  return new three.MeshLambertMaterial({
    color: colour,
    opacity,
    side,
    transparent: opacity < 1,
    depthWrite: opacity === 1,
  });
}

/**
 * A surface of even colour.
 * @param {string} colour
 * @param {number} [opacity]
 */
export function flat(colour, opacity = 1) {
  return new three.MeshBasicMaterial({
    color: colour,
    opacity,
    side: three.DoubleSide,
    transparent: opacity < 1,
    depthWrite: opacity === 1,
  });
}

/**
 * An arrow from the origin.
 * @param {Point} to
 * @param {string} colour
 * @param {number} radius
 */
export function arrow([x, y, z], colour, radius) {
  const length = Math.hypot(x, y, z);
  const head = radius * 7;
  const material = matt(colour);
  const shaft = new three.Mesh(
    new three.CylinderGeometry(radius, radius, length - head, 10),
    material,
  );
  shaft.position.y = (length - head) / 2;
  const cone = new three.Mesh(new three.ConeGeometry(radius * 2.8, head, 16), material);
  cone.position.y = length - head / 2;
  const group = new three.Group();
  group.add(shaft, cone);
  const along = new three.Vector3(x, y, z).normalize();
  group.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), along);
  return group;
}

/**
 * Segments between pairs of points.
 * @param {Point[]} points
 * @param {string} colour
 * @param {number} [opacity]
 */
export function segments(points, colour, opacity = 1) {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.Float32BufferAttribute(points.flat(), 3));
  const transparent = opacity < 1;
  return new three.LineSegments(
    geometry,
    new three.LineBasicMaterial({ color: colour, opacity, transparent }),
  );
}

/**
 * A word that faces the camera.
 * @param {string} text
 * @param {string} colour
 * @param {Point} at
 * @param {number} height
 * @param {number} [weight]
 */
export function word(text, colour, at, height, weight = 600) {
  const canvas = document.createElement("canvas");
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const font = `${weight} 56px system-ui, sans-serif`;
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 16;
  canvas.height = 72;
  context.font = font;
  context.fillStyle = colour;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, canvas.width / 2, canvas.height / 2 + 3);
  const map = new three.CanvasTexture(canvas);
  map.colorSpace = three.SRGBColorSpace;
  const material = new three.SpriteMaterial({ map, transparent: true, depthWrite: false });
  const sprite = new three.Sprite(material);
  sprite.scale.set((height * canvas.width) / canvas.height, height, 1);
  sprite.position.set(...at);
  return sprite;
}
