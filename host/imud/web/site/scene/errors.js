// SPDX-License-Identifier: MIT
// @ts-check
// How sure a pose is, as shapes of two sigma: a sector of the compass ring about the
// heading, a cone about the body's z for the tilt.

import * as three from "../vendor/three/three.module.min.js";
import { errorsOf } from "../model.js";
import { heading } from "../rotation.js";
import { flat } from "./parts.js";
import { RING } from "./world.js";

/** @typedef {import("../model.js").Pose} Pose */

const SIGMAS = 2;
const CONE = 0.95; // its length
const STEPS = 24;
const LEAST = 0.4; // degrees: a thinner shape can't be seen

/** Belongs to a scene and its body. */
export class Errors {
  /**
   * @param {three.Scene} scene
   * @param {three.Group} body
   */
  constructor(scene, body) {
    this._body = body;
    this._sector = new three.Mesh(new three.BufferGeometry(), flat("#888888", 0.3));
    this._sector.renderOrder = -1;
    this._needle = new three.Mesh(needle(), flat("#888888"));
    this._cone = new three.Mesh(new three.BufferGeometry(), flat("#888888", 0.22));
    this._shown = { heading: -1, tilt: -1 };
    this._needle.position.z = 0.004;
    this._needle.visible = false; // until there is a pose
    scene.add(this._sector, this._needle);
  }

  /** Puts the cone back on a body that was rebuilt. */
  attach() {
    this._body.add(this._cone);
  }

  /** @param {import("./scene.js").Colours} colours */
  recolour(colours) {
    this._sector.material.color.set(colours.accent);
    this._needle.material.color.set(colours.accent);
    this._cone.material.color.set(colours.z);
  }

  /** @param {Pose} pose */
  show(pose) {
    const toNorth = heading(pose.q);
    const { heading_sigma_deg: sigma, tilt_sigma_deg: tilt } = errorsOf(pose);
    this._needle.visible = toNorth !== null;
    this._sector.visible = toNorth !== null && sigma !== null;
    const turn = (-(toNorth ?? 0) * Math.PI) / 180;
    this._needle.rotation.z = turn;
    this._sector.rotation.z = turn;
    if (sigma !== null && Math.abs(sigma - this._shown.heading) > 0.02) {
      this._shown.heading = sigma;
      this._sector.geometry.dispose();
      this._sector.geometry = sector(Math.min(180, Math.max(LEAST, SIGMAS * sigma)));
    }
    this._cone.visible = tilt !== null;
    if (tilt !== null && Math.abs(tilt - this._shown.tilt) > 0.02) {
      this._shown.tilt = tilt;
      this._cone.geometry.dispose();
      this._cone.geometry = cone(Math.min(80, Math.max(LEAST, SIGMAS * tilt)));
    }
  }
}

/** A mark outside the ring, at north. */
function needle() {
  const shape = new three.Shape();
  shape.moveTo(0, RING - 0.13);
  shape.lineTo(-0.05, RING - 0.005);
  shape.lineTo(0.05, RING - 0.005);
  return new three.ShapeGeometry(shape);
}

/** @param {number} half degrees on each side of north */
function sector(half) {
  const angle = (half * Math.PI) / 180;
  const begin = Math.PI / 2 - angle;
  const geometry = new three.CircleGeometry(RING, STEPS, begin, 2 * angle);
  return geometry.translate(0, 0, 0.002);
}

/** @param {number} half its angle from the axis, degrees */
function cone(half) {
  const radius = CONE * Math.tan((half * Math.PI) / 180);
  const geometry = new three.ConeGeometry(radius, CONE, STEPS, 1, true);
  // Three's cone stands on its base along y: turn it onto its apex, along z.
  return geometry.translate(0, -CONE / 2, 0).rotateX(-Math.PI / 2);
}
