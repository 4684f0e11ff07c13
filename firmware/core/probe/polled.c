// SPDX-License-Identifier: MIT
// See polled.h.
#include "core/probe/polled.h"

enum {
    UNITS = 16,  // of a microsecond
    // Before the edge can come: two questions, of which the first may be late.
    GUARD = 150 * UNITS,
    // A question takes 0.1 ms on a bus of 400 kHz: the variation spans it, in steps
    // that have no common divisor with it.
    SPAN = 100 * UNITS,
    STEP = 619,
    // How far a sensor's clock may wander within a period, as a part of it: 0.04 %.
    WANDER = 2500,
    // A cut moves the period by a part of what it cuts.
    GAIN = 16,
    // Edges that the period is learned from, while the sensor is asked all the time.
    LEARNED = 32,
    // What can lie anywhere within more than this has no time.
    WIDE = 300 * UNITS,
    // The next edge may not be nearer when the sample is read: else it is not known
    // which of two was read.
    CLEAR = 20 * UNITS,
};

static int32_t after(uint32_t one, uint32_t other) {
    return (int32_t)(one - other);
}

static uint32_t width_of(const struct polled *polled) {
    return polled->high - polled->low;
}

static uint32_t middle_of(const struct polled *polled) {
    return polled->low + width_of(polled) / 2;
}

void polled_begin(struct polled *polled, uint16_t rate_hz) {
    *polled = (struct polled){.period = UINT32_C(1000000) * UNITS / rate_hz,
                              .missed = polled->missed,
                              .edges = polled->edges};
}

uint32_t polled_wait_us(const struct polled *polled, uint32_t now_us) {
    if (polled->learned < LEARNED) {
        return 0;
    }
    const uint32_t varied = (uint32_t)polled->turn * STEP % SPAN;
    const uint32_t due = polled->low + polled->period - GUARD - varied;
    const int32_t wait = after(due, now_us * UNITS);
    return wait > 0 ? (uint32_t)wait / UNITS : 0;
}

void polled_no(struct polled *polled, uint32_t at_us) {
    polled->no_at = at_us * UNITS;
    polled->has_no = true;
}

static void move_period(struct polled *polled, int32_t by) {
    by = by > SPAN ? SPAN : by;
    by = by < -SPAN ? -SPAN : by;
    polled->period += (uint32_t)(by / GAIN);
}

// The first edge: known only where a no came before it.
static bool begin(struct polled *polled, uint32_t at) {
    const bool is_known = polled->has_no;
    polled->has_no = false;
    polled->edges++;
    if (!is_known) {
        polled->missed++;
        return false;
    }
    polled->low = polled->no_at;
    polled->high = at;
    polled->first = middle_of(polled);
    polled->has_edge = true;
    return true;
}

// One of the first edges: where it lies, and the mean period so far.
static void learn(struct polled *polled, uint32_t low, uint32_t high) {
    polled->low = low;
    polled->high = high;
    polled->learned++;
    polled->period = (middle_of(polled) - polled->first) / polled->learned;
}

// Moves the time of the last edge by this many periods.
static void advance(struct polled *polled, uint32_t periods) {
    const uint32_t wander = polled->period / WANDER * periods;
    polled->low += polled->period * periods - wander;
    polled->high += polled->period * periods + wander;
}

// Cuts where it lies. The cuts of neighbours between two answers move the period.
static void cut(struct polled *polled, uint32_t low, uint32_t high, bool is_even) {
    const int32_t late = after(low, polled->low);
    const int32_t early = after(polled->high, high);
    if (is_even && late > 0) {
        move_period(polled, late / 2);
    }
    if (is_even && early > 0) {
        move_period(polled, -early / 2);
    }
    if (after(low, polled->high) > 0 || after(polled->low, high) > 0) {
        polled->low = low;  // outside: the period is off, or the time was
        polled->high = high;
        return;
    }
    polled->low = late > 0 ? low : polled->low;
    polled->high = early > 0 ? high : polled->high;
}

// Follows the edge that an answer is about. False where it may have been another.
static bool follow(struct polled *polled, uint32_t at) {
    const bool is_seen =
        polled->has_no && after(polled->no_at, at - polled->period) > 0;
    const uint32_t low = is_seen ? polled->no_at : at - polled->period;
    uint32_t periods = (at - polled->low) / polled->period;
    periods = periods == 0 ? 1 : periods;
    polled->edges += periods;
    polled->missed = (uint16_t)(polled->missed + periods - 1);
    if (polled->learned < LEARNED) {
        if (periods == 1 && is_seen) {
            learn(polled, low, at);
            return width_of(polled) <= WIDE;
        }
        polled->first = polled->low = low;  // one was missed: learned from here on
        polled->high = at;
        polled->learned = 0;
        return is_seen && width_of(polled) <= WIDE;
    }
    advance(polled, periods);
    const bool is_it = periods == 1 || after(at, polled->high) >= 0 ||
                       (is_seen && after(low, polled->high - polled->period) >= 0);
    cut(polled, low, at, is_seen && periods == 1);
    // The next one may have taken its place before it is read.
    return is_it && width_of(polled) <= WIDE &&
           after(polled->low + polled->period, at) >= CLEAR;
}

bool polled_yes(struct polled *polled, uint32_t at_us, uint32_t *edge_us,
                uint16_t *missed) {
    const uint32_t at = at_us * UNITS;
    if (polled->has_edge) {
        const bool is_known = follow(polled, at);
        polled->has_no = false;
        polled->turn++;
        if (!is_known) {
            polled->missed++;
            return false;
        }
    } else if (!begin(polled, at)) {
        return false;
    }
    *edge_us = at_us - (at - middle_of(polled)) / UNITS;
    *missed = polled->missed;
    polled->missed = 0;
    return true;
}

bool polled_is_next(const struct polled *polled, uint32_t edge_us) {
    const uint32_t due = middle_of(polled) + polled->period;
    const int32_t off = after(edge_us * UNITS, due);
    return polled->has_edge && off > -WIDE && off < WIDE;
}

uint32_t polled_bound_us(const struct polled *polled) {
    return width_of(polled) / 2 / UNITS + 1;
}
