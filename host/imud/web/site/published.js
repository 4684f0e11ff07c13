// SPDX-License-Identifier: MIT
// @ts-check
// What the daemon publishes, as types: docs/pose.md. null: not known.
// Generated from published.toml by protocol/generate.py.

/** @typedef {[number, number, number]} Vector */
/** @typedef {[number, number, number, number]} Quaternion */

/**
 * @typedef {object} SinceOrigin One-sigma errors of a pose since a moment, in degrees. None: not known.
 * @property {number | null} heading_sigma_deg
 * @property {number | null} tilt_sigma_deg
 * @property {number | null} age_s
 * @property {string | null} void
 */

/**
 * @typedef {object} PoseFields Orientation and position of a probe in the world, which is east-north-up.
 * @property {string} probe
 * @property {number} seq
 * @property {number} number
 * @property {number} missing
 * @property {number} t_device_us
 * @property {number | null} t_ns
 * @property {number | null} t_bound_us
 * @property {number | null} age_us
 * @property {string | null} utc_host
 * @property {number | null} utc_bound_us
 * @property {Quaternion} q
 * @property {Vector | null} position_m
 * @property {Vector | null} normal
 * @property {number | null} tilt_sigma_deg
 * @property {number | null} heading_sigma_deg
 * @property {string[]} flags
 * @property {SinceOrigin | null} since_origin
 */

/**
 * @typedef {object} Aim How far a pose is from the target that its probe was given.
 * @property {string} probe
 * @property {number} number
 * @property {number} t_device_us
 * @property {number | null} t_ns
 * @property {string} target
 * @property {Quaternion} target_q
 * @property {"x" | "y" | "z" | "all"} axis
 * @property {number} tolerance_deg
 * @property {number} hold_s
 * @property {number} error_deg
 * @property {number | null} sigma_deg
 * @property {"origin" | "capture" | null} since
 * @property {string | null} void
 * @property {"off" | "unsure" | "sure"} state
 * @property {Vector} difference_deg
 * @property {number} held_s
 * @property {number | null} bound_deg
 * @property {boolean} is_reached
 */

// The numbers of a pose.
export const POSE_NUMBERS = [
  "tilt_sigma_deg",
  "heading_sigma_deg",
];
