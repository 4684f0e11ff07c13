// SPDX-License-Identifier: MIT
// @ts-check
// The 3D picture: a probe in the world, which is east-north-up. Drawn only when something
// has changed.

import * as three from "../vendor/three/three.module.min.js";
import { rotate } from "../rotation.js";
import { isDrawnByProcessor } from "./card.js";
import { Orbit } from "./orbit.js";
import { makeWorld } from "./world.js";
import { makeCuboid, makeProbe } from "./bodies.js";
import { Errors } from "./errors.js";
import { Path } from "./path.js";
import { Trail } from "./trail.js";

/** @typedef {import("../model.js").Pose} Pose */
/** @typedef {"probe" | "cuboid"} BodyName */
/** @typedef {{ ink: string, muted: string, line: string, surface: string,
 *   accent: string, good: string, x: string, y: string, z: string, warn: string }} Colours */

const NOSE = /** @type {const} */ ([1.02, 0, 0]);

// With fewer frames a second than SLOW_HZ the picture gets coarser, down to a part of the
// screen's pixels; with more than FAST_HZ it gets finer again.
const SLOW_HZ = 35;
const FAST_HZ = 55;
const COARSEST = 0.5;
// A processor takes half the time without smooth edges, and a third of what is left for
// the ground, which the picture can do without.
const FINEST_BY_PROCESSOR = 0.75;

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

/** Owns a canvas that fills its parent. */
export class Scene {
  /**
   * @param {HTMLElement} parent
   * @param {three.Object3D} [attached] turns with the body, in the place of its path and
   *   of the shapes of its errors
   */
  constructor(parent, attached) {
    this._attached = attached;
    this.frames = 0;
    this.body = new three.Group();
    this._isSlow = isDrawnByProcessor();
    this._renderer = new three.WebGLRenderer({ antialias: !this._isSlow, alpha: true });
    this._finest = this._isSlow ? FINEST_BY_PROCESSOR : Math.min(devicePixelRatio, 2);
    this._ratio = this._finest;
    this._renderer.setPixelRatio(this._ratio);
    this.canvas = this._renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    parent.append(this.canvas);
    this._camera = new three.PerspectiveCamera(32, 1, 0.1, 50);
    this._camera.up.set(0, 0, 1);
    this.orbit = new Orbit(this.canvas, () => this.invalidate());
    this._scene = new three.Scene();
    this._light();
    this._scene.add(this.body);
    this._errors = new Errors(this._scene, this.body);
    this._trail = new Trail(this._isSlow ? 90 : 180);
    this.path = new Path();
    this._scene.add(this._trail.line, this.path.group);
    /** @type {three.Object3D | null} */
    this._world = null;
    /** @type {BodyName} */
    this._kind = "probe";
    this._isDirty = true;
    this._isStale = false;
    /** @type {Pose | null} */
    this._pose = null;
    this._resizer = new ResizeObserver(() => this._resize(parent));
    this._resizer.observe(parent);
    this.recolour();
  }

  /** Takes the theme's colours again. */
  recolour() {
    const colours = coloursOf();
    this._world?.removeFromParent();
    this._world = makeWorld(colours, !this._isSlow);
    this._scene.add(this._world);
    this._errors.recolour(colours);
    this._trail.recolour(colours);
    this.path.recolour(colours);
    this.setBody(this._kind);
  }

  /** @param {BodyName} kind */
  setBody(kind) {
    this._kind = kind;
    const make = kind === "cuboid" ? makeCuboid : makeProbe;
    this.body.clear();
    this.body.add(make(coloursOf()));
    if (this._attached) {
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
    this._isDirty = true;
  }

  /**
   * Shows the strokes and the place of a probe.
   * @param {import("../strokes.js").Strokes} strokes
   * @param {readonly [number, number, number] | null} tip metres from the origin
   */
  showPath(strokes, tip) {
    if (this.path.show(strokes, tip)) {
      this._isDirty = true;
    }
  }

  /**
   * Draws coarser where the machine is slow, as with software rendering.
   * @param {number} hz frames a second
   */
  adapt(hz) {
    const factor = hz < SLOW_HZ ? 0.75 : hz > FAST_HZ ? 1.2 : 1;
    const ratio = Math.min(this._finest, Math.max(COARSEST, this._ratio * factor));
    if (ratio !== this._ratio) {
      this._ratio = ratio;
      this._renderer.setPixelRatio(ratio);
      this._isDirty = true;
      this.draw();
    }
  }

  /** Has the next frame drawn. */
  invalidate() {
    this._isDirty = true;
  }

  /** Draws, if something has changed. */
  draw() {
    if (this._isDirty && this.canvas.width > 1) {
      this._isDirty = false;
      this.orbit.place(this._camera);
      this._renderer.render(this._scene, this._camera);
      this.frames += 1;
    }
  }

  close() {
    this._resizer.disconnect();
    this._renderer.dispose();
    this._renderer.forceContextLoss();
    this.canvas.remove();
  }

  _light() {
    this._scene.add(new three.HemisphereLight(0xffffff, 0x8893a8, 1.9));
    const sun = new three.DirectionalLight(0xffffff, 1.7);
    sun.position.set(-2, -3, 5);
    this._scene.add(sun);
  }

  /** @param {HTMLElement} parent */
  _resize(parent) {
    const { clientWidth: width, clientHeight: height } = parent;
    if (width === 0 || height === 0) {
      return;
    }
    this._renderer.setSize(width, height);
    this._camera.aspect = width / height;
    // A narrow picture needs a wider view for the ring to fit.
    this.orbit.fit = Math.max(1, 1.25 * (height / width));
    this._camera.updateProjectionMatrix();
    this._isDirty = true;
    this.draw();
  }
}
