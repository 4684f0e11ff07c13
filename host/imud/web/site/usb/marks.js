// SPDX-License-Identifier: MIT
// @ts-check
// The marks of one probe, as probes/mark.py makes them; kept until the page is closed.

/** @typedef {import("../link.js").Line} Line */
/** @typedef {import("./reader.js").Reader} Reader */

const KEPT_MAX = 200;
const POSE = ["number", "t_device_us", "q", "position_m", "normal", "flags", "since_origin"];

/** @param {Reader} reader */
function noPosition({ pose, params }) {
  if (!pose) {
    return "no pose at this moment; start the stream";
  }
  if (pose.position_m !== null) {
    return null;
  }
  if (!params.records?.tip?.offset) {
    return "the position of its tip is unknown; calibrate the tip";
  }
  const isTared = pose.flags.includes("tared");
  return isTared ? "a stroke since the origin has no length; set the origin again" : "it has no origin; set one";
}

/**
 * The errors by which its pose is judged: since the origin, or those of both ends.
 * @param {any} pose
 */
function sigmasOf(pose) {
  if (!pose || (pose.since_origin && pose.since_origin.void === null)) {
    return pose?.since_origin ?? {};
  }
  const ends = pose.flags.includes("tared") ? Math.SQRT2 : 1;
  const both = (/** @type {number | null} */ sigma) => sigma && ends * sigma;
  return { tilt_sigma_deg: both(pose.tilt_sigma_deg), heading_sigma_deg: both(pose.heading_sigma_deg) };
}

/**
 * One-sigma error of an axis of the tip's place; null: not known.
 * @param {Reader} reader
 */
function placeSigma({ pose, params, pathSigma }) {
  const { offset, sigma } = params.records?.tip ?? {};
  const { tilt_sigma_deg: tilt, heading_sigma_deg: turn } = sigmasOf(pose);
  if (!pose?.position_m || sigma == null || !offset || tilt == null || turn == null) {
    return null;
  }
  const turned = (Math.hypot(tilt, turn) * Math.PI) / 180;
  return Math.hypot(sigma, Math.hypot(...offset) * turned, Math.max(0, ...(pathSigma ?? [])));
}

/** Marks by their ids: the UTC in ns when each was made. */
export class MarkBook {
  constructor() {
    /** @type {Map<string, Line>} */
    this._all = new Map();
  }

  /** The oldest first. */
  get all() {
    return [...this._all.values()];
  }

  /**
   * Makes one, corrects it or takes it back; returns it as it is now.
   * @param {Reader} reader
   * @param {Record<string, string>} given
   * @param {number} nowMs
   */
  take(reader, { id, withdraw, value, unit, text }, nowMs) {
    const known = id === undefined ? null : this._all.get(id);
    if (known === undefined) {
      throw new Error("no such mark");
    }
    if (withdraw) {
      this._all.delete(id);
      return { ...known, state: "withdrawn" };
    }
    if ((value && !Number.isFinite(Number(value))) || !(value || text || known)) {
      throw new Error("a mark needs a number, or a note");
    }
    const { tilt_sigma_deg: tilt = null, heading_sigma_deg: heading = null } = sigmasOf(reader.pose);
    const place = known ?? {
      type: "mark",
      id: String(BigInt(Math.round(nowMs)) * 1_000_000n),
      ...Object.fromEntries(POSE.map((key) => [key, reader.pose?.[key] ?? null])),
      no_position: noPosition(reader),
      t_pose_ns: reader.pose?.t_ns ?? null,
      tilt_sigma_deg: tilt,
      heading_sigma_deg: heading,
      position_sigma_m: placeSigma(reader),
    };
    const noted = { value: value ? Number(value) : null, unit: unit ?? "", text: text ?? "" };
    const mark = /** @type {Line} */ ({ ...place, ...noted, state: known ? "corrected" : "new" });
    this._all.set(mark.id, mark);
    this._all.delete(this._all.size > KEPT_MAX ? this.all[0].id : "");
    return mark;
  }
}
