// SPDX-License-Identifier: MIT
// @ts-check
// A 3D picture that fills its parent, with a camera that people turn. Drawn only when
// something has changed.

import * as three from "../vendor/three/three.module.min.js";
import { mark } from "../dom.js";
import { isDrawnByProcessor } from "./card.js";
import { Orbit } from "./orbit.js";

// With fewer frames a second than SLOW_HZ the picture gets coarser, down to a part of the
// screen's pixels; with more than FAST_HZ it gets finer again.
const SLOW_HZ = 35;
const FAST_HZ = 55;
const COARSEST = 0.5;
// A processor takes half the time without smooth edges, and a third of what is left for
// the ground, which the picture can do without.
const FINEST_BY_PROCESSOR = 0.75;

/** The world is east-north-up, or a body's: z is up. */
export class View3d {
  /** @param {HTMLElement} parent */
  constructor(parent) {
    this.frames = 0;
    this._isSlow = isDrawnByProcessor();
    this._renderer = new three.WebGLRenderer({ antialias: !this._isSlow, alpha: true });
    this._finest = this._isSlow ? FINEST_BY_PROCESSOR : Math.min(devicePixelRatio, 2);
    this._ratio = this._finest;
    this._renderer.setPixelRatio(this._ratio);
    this.canvas = this._renderer.domElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.describe("A picture, drawn once a pose arrives");
    parent.append(this.canvas);
    this._camera = new three.PerspectiveCamera(32, 1, 0.1, 50);
    this._camera.up.set(0, 0, 1);
    this.orbit = new Orbit(this.canvas, () => this.invalidate());
    this._scene = new three.Scene();
    this._light();
    this._isDirty = true;
    this._resizer = new ResizeObserver(() => this._resize(parent));
    this._resizer.observe(parent);
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

  /**
   * Says in words what the picture shows.
   * @param {string} text
   */
  describe(text) {
    mark(this.canvas, "aria-label", text);
  }

  /**
   * The picture as it is now.
   * @returns {Promise<Blob | null>}
   */
  picture() {
    // What was drawn is there until the browser has shown it.
    this.invalidate();
    this.draw();
    return new Promise((resolve) => this.canvas.toBlob(resolve));
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
