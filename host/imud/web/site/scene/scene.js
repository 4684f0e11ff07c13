// SPDX-License-Identifier: MIT
// @ts-check
// The 3D picture: a probe in the world, which is east-north-up. Drawn only when something
// has changed.

import * as three from "../vendor/three/three.module.min.js";
import { rotate } from "../rotation.js";
import { makeWorld } from "./world.js";
import { makeCuboid, makeProbe } from "./bodies.js";
import { Errors } from "./errors.js";
import { Path } from "./path.js";
import { Trail } from "./trail.js";
import { View3d } from "./view3d.js";

/** @typedef {import("../model.js").Pose} Pose */
/** @typedef {"probe" | "cuboid"} BodyName */
/** @typedef {{ ink: string, muted: string, line: string, surface: string,
 *   accent: string, good: string, x: string, y: string, z: string, warn: string }} Colours */

const NOSE = /** @type {const} */ ([1.02, 0, 0]);

/** The colours of the page's theme. */
export function coloursOf(element = document.documentElement) {
  const style = getComputedStyle(element);
  const of = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`).trim();
  return {
    ink: of("ink"),
    muted: of("muted"),
    line: of("line"),
    surface: of("surface"),
    accent: of("accent"),
    good: of("good"),
    x: of("axis-x"),
    y: of("axis-y"),
    z: of("axis-z"),
    warn: of("warn"),
  };
}

/** A probe in a canvas that fills its parent. */
export class Scene extends View3d {
  /**
   * @param {HTMLElement} parent
   * @param {three.Object3D} [attached] turns with the body, in the place of its path and
   *   of the shapes of its errors
   * @param {three.Object3D} [beside] stands in the world
   */
  constructor(parent, attached, beside) {
    super(parent);
    this._attached = attached;
    this.body = new three.Group();
    this.body.visible = false; // until there is a pose
    this._scene.add(this.body, ...(beside ? [beside] : []));
    this._errors = new Errors(this._scene, this.body);
    this._trail = new Trail(this._isSlow ? 90 : 180);
    this.path = new Path();
    this._scene.add(this._trail.line, this.path.group);
    /** @type {three.Object3D | null} */
    this._world = null;
    this._isOrigin = false;
    /** @type {BodyName} */
    this._kind = "probe";
    this._isStale = false;
    /** @type {Pose | null} */
    this._pose = null;
    this.recolour();
  }

  /** Takes the theme's colours again. */
  recolour() {
    const colours = coloursOf();
    this._makeWorld();
    this._errors.recolour(colours);
    this._trail.recolour(colours);
    this.path.recolour(colours);
    this.setBody(this._kind);
  }

  _makeWorld() {
    this._world?.removeFromParent();
    if (this._attached) {
      return; // what it is to do stands beside it, without compass and words
    }
    this._world = makeWorld(coloursOf(), !this._isSlow, this._isOrigin);
    this._scene.add(this._world);
  }

  /** @param {BodyName} kind */
  setBody(kind) {
    this._kind = kind;
    const make = kind === "cuboid" ? makeCuboid : makeProbe;
    this.body.clear();
    this.body.add(make(coloursOf()));
    if (this._attached) {
      this.body.traverse((part) => {
        part.visible &&= !(part instanceof three.Sprite);
      });
      this.body.add(this._attached);
    } else {
      this._errors.attach();
    }
    this.setStale(this._isStale, true);
  }

  /**
   * Fades the body while its pose is old.
   * @param {boolean} isStale
   */
  setStale(isStale, always = false) {
    if (isStale === this._isStale && !always) {
      return;
    }
    this._isStale = isStale;
    this.body.traverse((part) => {
      const material = /** @type {any} */ (part).material;
      if (material && material.userData.opacity === undefined) {
        material.userData.opacity = material.opacity;
        material.userData.transparent = material.transparent;
      }
      if (material) {
        material.transparent = isStale || material.userData.transparent;
        material.opacity = material.userData.opacity * (isStale ? 0.3 : 1);
        material.needsUpdate = true;
      }
    });
    this.invalidate();
  }

  /**
   * Shows a pose.
   * @param {Pose} pose
   */
  show(pose) {
    if (pose === this._pose) {
      return;
    }
    this._pose = pose;
    this.body.visible = true;
    const isOrigin = pose.flags.includes("tared");
    if (isOrigin !== this._isOrigin) {
      this._isOrigin = isOrigin;
      this._makeWorld();
    }
    const [w, x, y, z] = pose.q;
    this.body.quaternion.set(x, y, z, w);
    if (!this._attached) {
      this._errors.show(pose);
    }
    const nose = rotate(pose.q, NOSE);
    // Where the tip is known its nose is there; else the probe turns about the origin.
    const { scale } = this.path;
    const tip = (scale ? pose.position_m?.map((metres) => metres * scale) : null) ?? nose;
    this.body.position.set(tip[0] - nose[0], tip[1] - nose[1], tip[2] - nose[2]);
    this._trail.add(this._attached ? null : [tip[0], tip[1], tip[2]]);
    const [east, north] = rotate(pose.q, [1, 0, 0]);
    this.orbit.follow(Math.atan2(north, east), Math.hypot(east, north));
    this.invalidate();
  }

  /**
   * Shows the strokes and the place of a probe.
   * @param {import("../strokes.js").Strokes} strokes
   * @param {readonly [number, number, number] | null} tip metres from the origin
   */
  showPath(strokes, tip) {
    if (this.path.show(strokes, tip)) {
      this.invalidate();
    }
  }
}
