// SPDX-License-Identifier: MIT
// @ts-check
// Ten minutes of one kind of message, as columns of numbers in a ring of fixed size.

export const KEPT_S = 600;
// Rows closer than this are left out, so that ten minutes always fit: 250 a second.
const APART_S = 0.0039;
const ROWS = Math.ceil(KEPT_S / APART_S);

/** Rows of a time and some values; NaN is a value that is not known. */
export class History {
  /** @param {readonly string[]} names of its columns */
  constructor(names) {
    this.names = names;
    // Memory grows in steps with what is kept, up to the whole ring.
    this._rows = 4096;
    this._times = new Float64Array(this._rows);
    this._columns = names.map(() => new Float32Array(this._rows));
    this._count = 0; // of all rows so far
    this._kept = 0;
    this.left = 0;
  }

  get length() {
    return this._kept;
  }

  /** The time of the last row, s; NaN without one. */
  get last() {
    return this._kept ? this.time(this._kept - 1) : NaN;
  }

  /**
   * Adds a row; one that is not later than the last is left out.
   * @param {number} time seconds
   * @param {readonly number[]} values
   */
  add(time, values) {
    if (this._kept > 0) {
      const gap = time - this.last;
      if (gap < APART_S) {
        if (gap > -1) {
          this.left += 1;
          return;
        }
        this.clear(); // the clock was set back, or another boot of the probe
      }
    }
    if (this._kept === this._rows && this._rows < ROWS) {
      this._grow();
    }
    const place = this._count % this._rows;
    this._times[place] = time;
    this._columns.forEach((column, index) => {
      column[place] = values[index];
    });
    this._count += 1;
    this._kept = Math.min(this._kept + 1, this._rows);
  }

  clear() {
    this._count = this._kept = 0;
  }

  /** @param {number} row 0 is the oldest */
  time(row) {
    return this._times[this._place(row)];
  }

  /**
   * @param {number} column
   * @param {number} row
   */
  value(column, row) {
    return this._columns[column][this._place(row)];
  }

  /**
   * The first row at that time or later.
   * @param {number} time
   */
  find(time) {
    let low = 0;
    let high = this._kept;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < time) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return low;
  }

  /** @param {number} row */
  _place(row) {
    return (this._count - this._kept + row) % this._rows;
  }

  _grow() {
    const rows = Math.min(2 * this._rows, ROWS);
    const times = new Float64Array(rows);
    const columns = this.names.map(() => new Float32Array(rows));
    for (let row = 0; row < this._kept; row++) {
      const place = this._place(row);
      times[row] = this._times[place];
      columns.forEach((column, index) => {
        column[row] = this._columns[index][place];
      });
    }
    this._times = times;
    this._columns = columns;
    this._rows = rows;
    this._count = this._kept;
  }
}
