// SPDX-License-Identifier: MIT
// @ts-check
// The camera turns about the origin: by pointer, wheel, two fingers, or the arrow keys.

/** @typedef {import("../vendor/three/three.module.min.js").PerspectiveCamera} Camera */

const START = { azimuth: -2.05, elevation: 0.42, distance: 5.1 };
const BEHIND = { azimuth: Math.PI, elevation: 0.35 };
const TURN = 0.006; // radians a pixel
const STEP = 0.1; // radians a key
const NEAREST = 2.2;
const FARTHEST = 12;

/** Where the camera is, as angles. */
export class Orbit {
  /**
   * @param {HTMLElement} element
   * @param {() => void} onChange
   */
  constructor(element, onChange) {
    this._onChange = onChange;
    this._azimuth = START.azimuth;
    this._elevation = START.elevation;
    this._distance = START.distance;
    this._heading = 0;
    this.fit = 1;
    this.isBehind = false;
    /** @type {Map<number, PointerEvent>} */
    this._pointers = new Map();
    element.style.touchAction = "none";
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this._pointers.set(event.pointerId, event);
    });
    element.addEventListener("pointermove", (event) => this._drag(event));
    for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) {
      element.addEventListener(name, (event) => this._pointers.delete(event.pointerId));
    }
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this._zoom(Math.exp(event.deltaY * 0.001));
    });
    element.addEventListener("keydown", (event) => this._press(event));
    element.addEventListener("dblclick", () => this.reset());
  }

  /** Back to the view at the start. */
  reset() {
    Object.assign(this, {
      _azimuth: this.isBehind ? BEHIND.azimuth : START.azimuth,
      _elevation: START.elevation,
      _distance: START.distance,
    });
    this._onChange();
  }

  /**
   * Whether the camera stays behind the probe or where it is in the world.
   * @param {boolean} isBehind
   */
  setBehind(isBehind) {
    this.isBehind = isBehind;
    this.reset();
  }

  /**
   * The probe points there, radians from east to north; `level` is how far it lies.
   * @param {number} heading
   * @param {number} level
   */
  follow(heading, level) {
    if (level > 0.1) {
      this._heading = heading;
    }
  }

  /** @param {Camera} camera */
  place(camera) {
    const azimuth = this._azimuth + (this.isBehind ? this._heading : 0);
    const distance = this._distance * this.fit;
    const flat = distance * Math.cos(this._elevation);
    camera.position.set(
      flat * Math.cos(azimuth),
      flat * Math.sin(azimuth),
      distance * Math.sin(this._elevation),
    );
    camera.lookAt(0, 0, 0.06);
  }

  /**
   * @param {number} turn
   * @param {number} lift
   */
  _move(turn, lift) {
    this._azimuth += turn;
    this._elevation = Math.max(-1.5, Math.min(1.5, this._elevation + lift));
    this._onChange();
  }

  /** @param {number} factor */
  _zoom(factor) {
    this._distance = Math.max(NEAREST, Math.min(FARTHEST, this._distance * factor));
    this._onChange();
  }

  /** @param {PointerEvent} event */
  _drag(event) {
    const before = this._pointers.get(event.pointerId);
    if (before === undefined) {
      return;
    }
    const others = [...this._pointers.values()].filter((one) => one !== before);
    this._pointers.set(event.pointerId, event);
    if (others.length === 1) {
      const [other] = others;
      const gap = (/** @type {PointerEvent} */ one) =>
        Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
      this._zoom(gap(before) / Math.max(1, gap(event)));
    } else {
      const across = event.clientX - before.clientX;
      this._move(-across * TURN, (event.clientY - before.clientY) * TURN);
    }
  }

  /** @param {KeyboardEvent} event */
  _press(event) {
    const moves = /** @type {Record<string, () => void>} */ ({
      ArrowLeft: () => this._move(-STEP, 0),
      ArrowRight: () => this._move(STEP, 0),
      ArrowUp: () => this._move(0, STEP),
      ArrowDown: () => this._move(0, -STEP),
      "+": () => this._zoom(0.9),
      "-": () => this._zoom(1.1),
      Home: () => this.reset(),
    });
    const move = moves[event.key];
    if (move && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      move();
    }
  }
}
