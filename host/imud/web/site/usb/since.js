// SPDX-License-Identifier: MIT
// @ts-check
// The errors of poses since the origin: the equations of probes/relative_error.py and
// references.py, for a page without them. tests/web/test_alone.py compares each pose.

/** @typedef {import("../published.js").SinceOrigin} Since */
/** @typedef {import("../rotation.js").Quat} Quat */

const DEGREES = 180 / Math.PI;
const GRAVITY_M_S2 = 9.80665;
const [LEVEL_MAX_RAD, TILT_FLOOR_DEG] = [0.06, 0.38]; // core/fusion/fuse_params.h
const UNKNOWN = { gyr: 0.01, settling: 0.25, acc: 0.06 * GRAVITY_M_S2, mag: 21, horizontal: 15 };
const [PAUSE_US, PAUSE_DPS, PAUSE_MAX_US, STEP_US] = [250_000, 180, 1_500_000, 45_000];
const MOVING_DEG = 0.1;
const [EVEN_DEG2, UNEVEN_S, UNEVEN_MAX_DEG2, SETTLING] = [0.2, 60, 10, 0.5];
const LOST_DEG = 1e9;
/** @type {Quat} */
const UNTURNED = [1, 0, 0, 0];

/** @param {import("./params.js").Records | null} records */
function qualityOf(records) {
  const { gyr, acc, mag } = records ?? {};
  const accRad = (acc?.sigma ?? UNKNOWN.acc) / GRAVITY_M_S2;
  const hasField = mag?.norm != null && mag?.dip != null;
  const horizontal = hasField ? Math.max(1, mag.norm * Math.cos(mag.dip / DEGREES)) : UNKNOWN.horizontal;
  return {
    gyrShare: gyr?.sigma ?? UNKNOWN.gyr,
    settling: gyr?.sigma == null ? UNKNOWN.settling : 0,
    mag: ((mag?.sigma ?? UNKNOWN.mag) / horizontal) * DEGREES,
    acc: accRad * DEGREES,
    level2: (Math.min(Math.SQRT2 * accRad, LEVEL_MAX_RAD) * DEGREES) ** 2,
  };
}

/** @param {number} value */
const rounded = (value) => Number(value.toFixed(3));

/** @param {number} variance @param {number} most */
const capped = (variance, most) => rounded(Math.sqrt((variance * most) / (variance + most)));

/** Follows one boot of a probe. */
export class SinceOrigin {
  constructor() {
    this._quality = qualityOf(null);
    /** @type {any} */
    this._origin = null;
    /** @type {{ isHeading: boolean, t_us: number } | null} */
    this._awaited = null;
    /** @type {{ q: Quat, t_us: number } | null} */
    this._before = null;
    this._turned = { any: 0, up: 0, net: 0, unheard: 0 };
    this._uneven = { least: Infinity, begun: Infinity, mean: 0, t_us: 0 };
  }

  /** @param {import("./params.js").Records | null} records */
  tell(records) {
    this._quality = qualityOf(records);
  }

  /** @param {string} why */
  end(why) {
    if (this._origin !== null) {
      this._origin.void ??= why;
    }
  }

  /**
   * @param {Record<string, any>} event
   * @param {number} timeUs
   */
  onEvent({ event, detail }, timeUs) {
    if (event === "tared") {
      this._awaited = detail === 0 || detail === 1 ? { isHeading: detail === 1, t_us: timeUs } : null;
      this._origin = this._awaited && this._origin;
    } else if (event === "restarted" || event === "params_changed") {
      this.end(event);
      if (event === "restarted") {
        this._uneven = { least: Infinity, begun: Infinity, mean: 0, t_us: 0 };
      }
    }
  }

  /**
   * The errors of a pose since the origin; null: there is none.
   * @param {any} pose
   * @returns {Since | null}
   */
  onPose(pose) {
    const { q, t_device_us: timeUs, heading_sigma_deg: heading, flags } = pose;
    this._addUnevenness(heading, timeUs);
    if (this._origin !== null || flags.includes("tared")) {
      this._followOrigin(pose);
    }
    if (this._origin === null || this._origin.void !== null) {
      this._before = null;
    } else {
      if (flags.includes("starting")) {
        this.end("starting");
      } else if (flags.includes("gap") && !flags.includes("at_rest")) {
        this.end("gap");
      }
      this._turned.up += heading === null ? LOST_DEG : 0;
      const gapUs = this._before === null ? Infinity : timeUs - this._before.t_us;
      if (gapUs >= STEP_US) {
        if (this._before !== null && gapUs > PAUSE_MAX_US) {
          this.end("pause");
        }
        this._turn(q, timeUs);
      }
    }
    return this._origin && this._since(pose);
  }

  /** @param {number | null} sigma @param {number} timeUs */
  _addUnevenness(sigma, timeUs) {
    const uneven = this._uneven;
    const seconds = Math.min(1, Math.max(0, (timeUs - uneven.t_us) * 1e-6));
    uneven.t_us = timeUs;
    if (sigma === null) {
      return;
    }
    uneven.least = Math.min(uneven.least, sigma);
    if (sigma < SETTLING * uneven.begun) {
      [uneven.begun, uneven.mean] = [sigma, 0];
    }
    const above = sigma * sigma - uneven.least * uneven.least;
    uneven.mean += ((Math.min(above, UNEVEN_MAX_DEG2) - uneven.mean) * seconds) / UNEVEN_S;
  }

  /** @param {any} pose */
  _followOrigin(pose) {
    const awaited = this._awaited;
    this._awaited = null;
    const origin = (/** @type {Quat} */ q, /** @type {number} */ timeUs, isHeading = false) => ({
      q,
      t_us: timeUs,
      isHeading,
      heading: pose.heading_sigma_deg,
      tilt: pose.tilt_sigma_deg,
      turned: { ...this._turned },
      void: /** @type {string | null} */ (null),
    });
    if (!pose.flags.includes("tared")) {
      this._origin = this._before = null;
    } else if (awaited !== null) {
      const q = awaited.isHeading ? pose.q : UNTURNED;
      this._before = { q, t_us: awaited.t_us };
      this._origin = origin(q, awaited.t_us, awaited.isHeading);
    } else if (this._origin === null) {
      this._origin = { ...origin(UNTURNED, 0), void: "unheard" };
    }
  }

  /** @param {Quat} q @param {number} timeUs */
  _turn(q, timeUs) {
    const before = this._before;
    this._before = { q, t_us: timeUs };
    if (before === null || timeUs <= before.t_us) {
      return;
    }
    const [w0, x0, y0, z0] = before.q;
    const [w1, x1, y1, z1] = q;
    const w = w1 * w0 + x1 * x0 + y1 * y0 + z1 * z0;
    const x = x1 * w0 - w1 * x0 - y1 * z0 + z1 * y0;
    const y = y1 * w0 - w1 * y0 - z1 * x0 + x1 * z0;
    const z = z1 * w0 - w1 * z0 - x1 * y0 + y1 * x0;
    const sine = Math.sqrt(x * x + y * y + z * z);
    const turned = sine === 0 ? 0 : 2 * Math.atan2(sine, Math.abs(w)) * DEGREES;
    const up = sine === 0 ? 0 : Math.abs((turned * z) / sine) * (z * w < 0 ? -1 : 1);
    const elapsedUs = timeUs - before.t_us;
    const sums = this._turned;
    sums.net += up;
    if (elapsedUs > PAUSE_US) {
      const most = Math.max(turned, PAUSE_DPS * elapsedUs * 1e-6);
      sums.any += most;
      sums.up += most;
      sums.unheard += most;
    } else if (turned > MOVING_DEG) {
      sums.any += turned;
      sums.up += Math.abs(up);
    }
  }

  /** @param {any} pose @returns {Since} */
  _since(pose) {
    const then = this._origin;
    const age = Math.max(0, (pose.t_device_us - then.t_us) * 1e-6);
    /** @type {Since} */
    const found = { heading_sigma_deg: null, tilt_sigma_deg: null, age_s: age, void: then.void };
    if (then.void !== null) {
      return { ...found, age_s: then.void === "unheard" ? null : age };
    }
    const cosine = then.q.reduce((/** @type {number} */ sum, /** @type {number} */ each, /** @type {number} */ index) => {
      return sum + each * pose.q[index];
    }, 0);
    const half = 2 * Math.sqrt(1 - Math.min(1, Math.abs(cosine)) ** 2);
    const { tilt_sigma_deg: tilt, heading_sigma_deg: heading } = pose;
    if (then.isHeading) {
      found.tilt_sigma_deg = tilt;
    } else if (tilt !== null && then.tilt !== null) {
      const { level2, acc } = this._quality;
      const known = TILT_FLOOR_DEG ** 2 + level2;
      const levelling = Math.max(0, then.tilt ** 2 - known) + Math.max(0, tilt ** 2 - known);
      const variance = 0.02 ** 2 + 0.17 * levelling + 80 * (half * acc) ** 2;
      found.tilt_sigma_deg = capped(variance, tilt ** 2 + then.tilt ** 2);
    }
    if (heading !== null && then.heading !== null) {
      const most = then.heading ** 2 + heading ** 2;
      found.heading_sigma_deg = capped(this._heading(age, pose.t_device_us * 1e-6, half, most), most);
    }
    return found;
  }

  /**
   * The square of the heading's error, degrees^2.
   * @param {number} age s
   * @param {number} on s since power-on
   * @param {number} half twice the sine of half the angle between both attitudes
   * @param {number} most both squares
   */
  _heading(age, on, half, most) {
    const { gyrShare, settling, mag } = this._quality;
    const [now, then] = [this._turned, this._origin.turned];
    const any = now.any - then.any;
    const warmth = Math.exp(-(on - age) / 30) - Math.exp(-on / 30);
    const scale = 2 * gyrShare * (Math.abs(now.net - then.net) + now.unheard - then.unheard);
    const field = half * mag * -Math.expm1(-age / 20);
    const room = 3 * Math.max(0, this._uneven.mean - EVEN_DEG2) * Math.min(1, any / 20);
    const unsure = most - 2 * this._uneven.least ** 2;
    return (
      0.02 ** 2 +
      6e-5 * age +
      settling ** 2 * -Math.expm1(-age / 5) +
      0.3 * warmth * warmth +
      (5e-4 + 30 * gyrShare ** 2) * (now.up - then.up) +
      8e-4 * Math.min(60, any) +
      scale * scale +
      2 * field * field +
      0.05 * Math.min(1, any / 90) * unsure +
      room * -Math.expm1(-age / 10)
    );
  }
}
