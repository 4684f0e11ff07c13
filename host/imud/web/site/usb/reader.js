// SPDX-License-Identifier: MIT
// @ts-check
// What one port brings, as the lines that a daemon sends: poses, raw samples, strokes,
// events, and each second a status with the account. No I/O; time is an argument.

import { decode, FrameDecoder } from "./frames.js";
import { Params } from "./params.js";
import { SinceOrigin } from "./since.js";
import { FINGERPRINT, NO_ERRORS, PASSING, PUBLISHED, STROKE_ADVICE, WITHHELD } from "./wire.js";

/** @typedef {import("./frames.js").Message} Message */
/** @typedef {import("../link.js").Line} Line */

const WAITING_MAX = 3072; // messages before a hello, which comes every second
const GAP_MAX = 10_000; // of a sequence: a number that is farther ahead was damaged
const SILENT_MS = 3000;
const DRIFT = 0.006; // the most that a probe's clock is slow by, as a share
const STATES = /** @type {Record<string, string>} */ ({ stream_started: "streaming", stream_stopped: "idle" });
const SENSORS = { acc: "accelerometer", gyr: "gyroscope", mag: "magnetometer" };

/** One probe at one port. */
export class Reader {
  /** @param {(line: Line) => void} say */
  constructor(say) {
    this._say = say;
    this._decoder = new FrameDecoder();
    /** @type {Record<string, any> | null} */
    this.hello = null;
    /** @type {Record<string, any>} */
    this.counters = {};
    this.account = { messages: 0, lost: 0, corrupt: 0, late: 0, restarts: 0 };
    this.params = new Params();
    this._since = new SinceOrigin();
    /** @type {Message[]} */
    this._waiting = [];
    /** @type {Record<string, { number: number, lost: number }>} */
    this._kinds = {};
    this._next = this._suspect = 0;
    this._timeUs = NaN; // the latest, beyond 32 bits
    this._offsetMs = NaN; // of UTC to it
    this._heardMs = -Infinity;
    /** @type {any} */
    this.pose = null;
    /** @type {number[] | null} */
    this.pathSigma = null;
    this._poses = 0;
    this._tickMs = NaN;
    /** @type {any} */
    this._equipment = null;
    this.onReply = (/** @type {Record<string, any>} */ _) => {};
  }

  /** Its id; empty before its first hello. */
  get probe() {
    return String(this.hello?.probe_id ?? "");
  }

  get isOther() {
    return this.hello !== null && this.hello.schema_fingerprint !== FINGERPRINT;
  }

  /**
   * Bytes that have arrived.
   * @param {Uint8Array} data
   * @param {number} nowMs UTC
   */
  receive(data, nowMs) {
    for (const content of this._decoder.feed(data)) {
      const message = content && decode(content);
      if (message !== null) {
        this._heardMs = nowMs;
        this._note(message, nowMs);
      } else if (this.hello !== null && !this.isOther) {
        this.account.corrupt += 1; // of a probe that is just being joined nothing is known
      }
    }
  }

  /**
   * @param {Message} message
   * @param {number} nowMs
   */
  _note(message, nowMs) {
    const { name, sequence, fields } = message;
    if (name === "hello" && (this.hello === null || this.isOther || this._isRestart(message))) {
      const before = this._waiting.filter((each) => (sequence - each.sequence - 1) >>> 0 < GAP_MAX);
      this._begin(fields, before[0]?.sequence ?? sequence);
      before.forEach((each) => this._note(each, nowMs));
    }
    if (this.hello === null) {
      this._waiting.push(message);
      this._waiting.splice(0, this._waiting.length - WAITING_MAX);
      return;
    }
    if (!this.isOther && this._isNext(sequence)) {
      this._take(message, nowMs);
    }
  }

  /** @param {Message} hello */
  _isRestart({ sequence, fields }) {
    const isSame = fields.boot_count === this.hello?.boot_count && fields.probe_id === this.hello?.probe_id;
    return !isSame || (sequence === 0 && this._next !== 0);
  }

  /**
   * @param {Record<string, any>} hello
   * @param {number} sequence the first of this boot
   */
  _begin(hello, sequence) {
    this.account.restarts += this.hello === null ? 0 : 1;
    if (hello.probe_id !== this.hello?.probe_id) {
      this._kinds = {};
      this.params = new Params();
    }
    this.hello = hello;
    this._waiting = [];
    this._next = sequence;
    this._timeUs = this._offsetMs = NaN;
    this._since = new SinceOrigin();
    this._since.tell(this.params.records);
  }

  /**
   * Counts what is missing before this number; false: it is left out.
   * @param {number} sequence
   */
  _isNext(sequence) {
    const ahead = (sequence - this._next) >>> 0;
    const { account } = this;
    if (ahead > 0x7fffffff) {
      account.late += 1;
      return false;
    }
    if (ahead > GAP_MAX && (sequence - this._suspect) >>> 0 > GAP_MAX) {
      this._suspect = sequence;
      account.corrupt += 1;
      return false;
    }
    account.lost += ahead;
    account.messages += 1;
    this._next = (sequence + 1) >>> 0;
    return true;
  }

  /**
   * The number of a message and its times. Its UTC is that of the message that has been
   * on the way for the shortest time.
   * @param {Message} message
   * @param {number} nowMs
   */
  _stamp({ name, sequence, time_us: timeUs }, nowMs) {
    const kind = (this._kinds[name] ??= { number: 0, lost: 0 });
    const missing = this.account.lost - kind.lost;
    kind.lost = this.account.lost;
    kind.number += 1;
    const before = this._timeUs;
    const unrolled = Number.isNaN(before) ? timeUs : before + ((timeUs - before) | 0);
    const grownMs = this._offsetMs + (DRIFT * Math.max(0, unrolled - before)) / 1000;
    const offsetMs = nowMs - unrolled / 1000;
    this._offsetMs = Number.isNaN(grownMs) ? offsetMs : Math.min(grownMs, offsetMs);
    this._timeUs = Number.isNaN(before) ? unrolled : Math.max(before, unrolled);
    return {
      type: name,
      probe: this.probe,
      seq: sequence,
      number: kind.number,
      missing,
      t_device_us: unrolled,
      t_ns: Math.round(1e6 * (this._offsetMs + unrolled / 1000)),
      t_bound_us: null,
      age_us: null,
    };
  }

  /**
   * @param {Message} message
   * @param {number} nowMs
   */
  _take(message, nowMs) {
    const { name, fields } = message;
    const stamp = this._stamp(message, nowMs);
    /** @type {Line} */
    const line = stamp;
    for (const [key, field] of Object.entries(PUBLISHED[name] ?? {})) {
      line[key] = fields[field];
    }
    if (name === "pose") {
      line.since_origin = this._since.onPose(line);
      this.pose = line;
      this._poses += 1;
    } else if (name === "raw") {
      const { acc_lsb: acc, gyr_lsb: gyr, mag_lsb: mag } = this.hello ?? {};
      line.acc_m_s2 = this.params.measure("acc", fields.acc, acc);
      line.gyr_rad_s = this.params.measure("gyr", fields.gyr, gyr);
      line.mag_uT = this.params.measure("mag", fields.mag, mag);
    } else if (name === "stroke") {
      const ofAxes = (/** @type {number[] | null} */ sigma) => sigma && [sigma[0], sigma[0], sigma[1]];
      line.displacement_sigma_m = ofAxes(fields.displacement_sigma);
      line.path_sigma_m = ofAxes(fields.path_sigma);
      line.advice = STROKE_ADVICE[fields.end] ?? null;
      this.pathSigma = fields.end === "running" ? this.pathSigma : line.path_sigma_m;
    } else if (name === "event") {
      this._onEvent(fields, stamp.t_device_us);
    } else {
      this._tell(name, fields);
      return;
    }
    this._say(line);
  }

  /**
   * @param {Record<string, any>} event
   * @param {number} timeUs
   */
  _onEvent(event, timeUs) {
    if (event.event in STATES) {
      this.counters.state = STATES[event.event]; // until its next status
    } else if (event.event === "params_changed") {
      this.params.digest = event.detail >>> 0;
      this._since.tell(this.params.records);
    } else if (event.event === "tared") {
      this.pathSigma = null;
    }
    this._since.onEvent(event, timeUs);
  }

  /**
   * What messages say of the probe itself.
   * @param {string} name
   * @param {Record<string, any>} fields
   */
  _tell(name, fields) {
    if (name === "hello") {
      this.hello = fields;
      this.params.digest = fields.params_digest;
      this._since.tell(this.params.records);
    } else if (name === "params") {
      this.params.add(fields);
      this._since.tell(this.params.records);
    } else if (name === "status") {
      this.counters = fields;
    } else if (name === "equipment") {
      const part = (/** @type {string} */ each) => (fields[each] === "none" ? null : { state: fields[each] });
      const volts = fields.battery === null ? null : fields.battery / 1000;
      this._equipment = { battery_v: volts, power: fields.power, radio: part("radio"), card: part("card") };
    } else if (name === "reply") {
      this.onReply(fields);
    }
  }

  /**
   * Its status, once a second.
   * @param {string | null} port null: it is unplugged
   * @param {number} nowMs
   */
  tick(port, nowMs) {
    const { account, counters, hello } = this;
    const { lost, messages, late, corrupt } = account;
    const isSilent = nowMs - this._heardMs > SILENT_MS;
    const state = this.isOther ? "other schema" : isSilent ? "silent" : (counters.state ?? "unknown");
    const rate = Math.round((10_000 * this._poses) / (nowMs - this._tickMs)) / 10 || 0;
    [this._poses, this._tickMs] = [0, nowMs];
    this._say({
      type: "status",
      probe: this.probe,
      probe_id: this.probe,
      t_ns: nowMs * 1e6,
      state: port === null ? "gone" : state,
      port,
      pose_rate_hz: rate,
      quality: { withheld: this._withheld() },
      ledger: {
        ...{ sent: messages + lost, received: messages, lost, duplicated: late, corrupt },
        sensor: { ready: counters.samples_ready, read: counters.samples_read, overruns: counters.overruns },
        probe: { sent: counters.messages_sent, dropped: counters.messages_dropped },
      },
      params: this.params.summary,
      sensors: this._sensors(),
      counters,
      equipment: this._equipment,
      hello,
    });
  }

  /** Why the last pose states no error, as probes/withheld.py has it. */
  _withheld() {
    const { pose } = this;
    const reason = (/** @type {"tilt" | "heading"} */ name) => {
      if (!pose || pose[`${name}_sigma_deg`] !== null) {
        return null;
      }
      const found = Object.entries(WITHHELD[name]).find(([flag]) => pose.flags.includes(flag));
      return found ? found[1] : NO_ERRORS;
    };
    const [tilt, heading] = [reason("tilt"), reason("heading")];
    const lacks = tilt === heading ? [["tilt and no heading", tilt]] : Object.entries({ tilt, heading });
    const told = lacks.filter(([, why]) => why && !PASSING.includes(why));
    return { tilt, heading, words: told.map(([name, why]) => `no ${name}: ${why}`) };
  }

  /** What its own self-test says. */
  _sensors() {
    const failed = Object.entries(SENSORS).filter(([name]) => this.hello?.self_test?.includes(`${name}_failed`));
    const words = failed.map(([, name]) => `the ${name} failed its self-test: replace the module`);
    const isWorking = this.hello?.sensor !== "none";
    const none = isWorking ? [] : ["no sensor was found: check its wires"];
    return { words: [...none, ...words], flags: words.length > 0 ? ["self_test_failed"] : [], is_working: isWorking };
  }
}
