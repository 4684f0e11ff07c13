// SPDX-License-Identifier: MIT
// @ts-check
// Ten minutes of a limb: its angles, its foot from its root, and the events of its gait.
// Missing values are kept as missing.

import { History } from "../signals/history.js";

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("../signals/plots.js").Plot} Plot */
/** @typedef {{ t_ns: number, what: string, segment: string, stride_m: number | null }} GaitEvent */

const EVENTS_MAX = 200;
const COLOURS = ["axis-x", "axis-y", "axis-z"];
const AXES = ["x", "y", "z"];

/** Follows one limb. */
export class LimbRecorder {
  /** @param {string} name */
  constructor(name) {
    this.name = name;
    /** @type {History | null} */
    this.history = null;
    /** @type {Plot[]} */
    this.plots = [];
    /** @type {GaitEvent[]} */
    this.events = [];
    this._shape = "";
    /** @type {Map<string, boolean>} */
    this._isDown = new Map();
    /** @type {string[][]} */
    this._columns = [];
  }

  /** @param {Line} state */
  take(state) {
    this._gait(state);
    const known = state.joints.every((/** @type {Line} */ joint) => joint.angles_deg);
    if (known) {
      this._build(state);
    }
    this.history?.add(state.t_ns / 1e9, [...this._angles(state), ...footOf(state)]);
  }

  /**
   * Columns and plots for the joints of a state, replaced if the joints differ.
   * @param {Line} state
   * */
  _build(state) {
    const joints = /** @type {Line[]} */ (state.joints);
    const names = joints.map((joint) => Object.keys(joint.angles_deg));
    const shape = JSON.stringify([joints.map(({ child }) => child), names]);
    if (shape === this._shape) {
      return;
    }
    this._shape = shape;
    this._columns = names;
    const columns = joints.map((joint, index) => {
      return names[index].map((name) => `${joint.child}_${joint.kind}_${name}_deg`);
    });
    const foot = AXES.map((axis) => `foot_${axis}_m`);
    this.history = new History([...columns.flat(), ...foot]);
    this.plots = joints.map((joint, index) => ({
      id: `joint-${index}`,
      title: `${joint.kind[0].toUpperCase()}${joint.kind.slice(1)}`,
      unit: "°",
      source: "pose",
      series: names[index].map((name, at) => [name, columns[index][at], COLOURS[at % 3]]),
    }));
    const last = state.segments.at(-1).name;
    this.plots.push({
      id: "foot",
      title: `End of the ${last} from the root`,
      unit: "m",
      source: "pose",
      series: AXES.map((axis, at) => [["ahead", "left", "up"][at], `foot_${axis}_m`, COLOURS[at]]),
    });
  }

  /** @param {Line} state */
  _angles(state) {
    return this._columns.flatMap((names, index) => {
      const angles = state.joints[index]?.angles_deg;
      return names.map((name) => angles?.[name] ?? NaN);
    });
  }

  /** @param {Line} state */
  _gait({ t_ns, segments }) {
    for (const { name, contact } of segments) {
      if (!contact) {
        this._isDown.delete(name); // its state in between is unknown
        continue;
      }
      const before = this._isDown.get(name);
      this._isDown.set(name, contact.is_down);
      if (before !== undefined && before !== contact.is_down) {
        const what = contact.is_down ? "foot strike" : "toe off";
        const stride_m = contact.is_down ? null : contact.stride_m;
        this.events.push({ t_ns, what, segment: name, stride_m });
        this.events.splice(0, this.events.length - EVENTS_MAX);
      }
    }
  }
}

/**
 * The last segment's end, from the root.
 * @param {Line} state
 * @returns {readonly number[]}
 */
function footOf(state) {
  return state.segments.at(-1)?.end_m ?? [NaN, NaN, NaN];
}
