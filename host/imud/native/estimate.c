// SPDX-License-Identifier: MIT
// _core.estimate: a clock from upper and lower bounds of its host times.
// probes/clock.py keeps the bounds; docs/pose-details.md explains how.
#include "module.h"

#include <math.h>

// Largest error of the probe's oscillator: 1 % for an RC oscillator, 0.5 % for a
// ceramic resonator, 0.01 % for a crystal.
#define RATE_MAX 0.02

// Without replies to commands the rate is unknown: older arrivals mislead.
#define ALONE_S 2.0

// The estimate is this part of the possible range away from its edges, at least.
#define SHARE_MIN 0.25

// Slopes between the flattest and the steepest at which the range is evaluated.
#define SLOPES 5

// Gaps and ranges below it are rounding.
#define ROUNDING_NS 1e-3

// Bounds of one kind: upper ones with sign 1, lower ones with -1. A line over time has
// a value at 0 and a slope in ns/s.
struct side {
    double *x;  // seconds from the reference
    double *y;  // ns
    Py_ssize_t count;
    int sign;
};

// The value at 0 of the line with that slope that touches the tightest bound, and that
// bound's place. Bounds before `from_s` don't count.
static double tightest(const struct side *side, double slope, double from_s,
                       double *x) {
    double best = side->sign * HUGE_VAL;
    for (Py_ssize_t i = 0; i < side->count; i++) {
        if (side->x[i] <= from_s) {
            continue;
        }
        const double value = side->y[i] - slope * side->x[i];
        const double gained = side->sign * (best - value);
        if (gained > 0 || (gained == 0 && side->sign * (*x - side->x[i]) > 0)) {
            best = value;
            *x = side->x[i];
        }
    }
    return best;
}

// The slope of the steepest line between the bounds (`sign` 1) or of the flattest (-1).
// The gap between both hulls is a concave function of the slope, so Newton's method
// from outside converges to the edge. 0: there is no such line.
static int extreme(const struct side *above, const struct side *below, int sign,
                   double *slope) {
    *slope = sign * RATE_MAX * 1e9;
    for (Py_ssize_t i = 0; i < above->count + below->count + 2; i++) {
        double upper = 0;
        double lower = 0;
        const double top = tightest(above, *slope, -HUGE_VAL, &upper);
        const double gap = top - tightest(below, *slope, -HUGE_VAL, &lower);
        if (gap >= -ROUNDING_NS) {
            return 1;
        }
        const double run = upper - lower;
        if (sign * run <= 0) {
            return 0;
        }
        *slope += gap / run;
    }
    return 0;
}

static double mean_of(const struct side *side, double slope) {
    double sum = 0;
    for (Py_ssize_t i = 0; i < side->count; i++) {
        sum += side->y[i] - slope * side->x[i];
    }
    return sum / (double)side->count;
}

// Slope and value of the line in the middle of all possible ones, where each slope has
// the weight of its range of values.
static void centre(const struct side *above, const struct side *below, double flattest,
                   double steepest, double *slope, double *middle) {
    const double step = (steepest - flattest) / SLOPES;
    double weights = 0;
    double slopes = 0;
    double values = 0;
    for (int i = 0; i < SLOPES; i++) {
        double x = 0;
        const double at = flattest + (i + 0.5) * step;
        const double top = tightest(above, at, -HUGE_VAL, &x);
        const double bottom = tightest(below, at, -HUGE_VAL, &x);
        // The least of n delays is about 1/n of their mean. The truth is nearer to the
        // side with shorter delays, in that proportion.
        const double late = (mean_of(above, at) - top) / (double)above->count;
        const double early = (bottom - mean_of(below, at)) / (double)below->count;
        double share = early + late > 0 ? early / (early + late) : 0.5;
        share = fmin(fmax(share, SHARE_MIN), 1 - SHARE_MIN);
        const double weight = fmax(top - bottom, ROUNDING_NS);
        weights += weight;
        slopes += weight * at;
        values += weight * (bottom + share * (top - bottom));
    }
    *slope = slopes / weights;
    *middle = values / weights;
}

// Takes points (device time in us; host's less device's in ns), relative to `at_us`
// and `reference`, less strict by what the rate may have changed. 0 on success.
static int take_points(struct side *side, PyObject *points, long long at_us,
                       long long reference, double drift_max) {
    const Py_ssize_t count = PySequence_Size(points);
    if (count < 0) {
        return -1;
    }
    side->x = PyMem_Calloc((size_t)count + 1, 2 * sizeof *side->x);
    if (side->x == NULL) {
        PyErr_NoMemory();
        return -1;
    }
    side->y = side->x + count;
    for (; side->count < count; side->count++) {
        PyObject *point = PySequence_GetItem(points, side->count);
        long long device_us = 0;
        long long offset_ns = 0;
        const int is_read =
            point != NULL && PyArg_ParseTuple(point, "LL", &device_us, &offset_ns);
        Py_XDECREF(point);
        int64_t past_us = 0;
        int64_t least_ns = 0;
        if (!is_read) {
            return -1;
        }
        if (__builtin_sub_overflow(device_us, at_us, &past_us) ||
            __builtin_sub_overflow(offset_ns, reference, &least_ns)) {
            PyErr_SetString(PyExc_OverflowError, "a time is beyond 292 years");
            return -1;
        }
        const double x = (double)past_us * 1e-6;
        side->x[side->count] = x;
        side->y[side->count] =
            (double)least_ns + side->sign * drift_max / 2 * x * x * 1e9;
    }
    return 0;
}

// A new reference: the estimate; None: the bounds contradict each other.
static PyObject *estimate_of(const struct side *above, const struct side *below,
                             long long at_us, long long reference, double rate) {
    double slope = rate * 1e9;
    double middle = 0;
    double half_ns = -1;
    double spread = 0;
    if (below->count == 0) {
        double x = 0;
        middle = tightest(above, slope, -ALONE_S, &x);
    } else {
        double steepest = 0;
        double flattest = 0;
        double x = 0;
        if (!extreme(above, below, 1, &steepest) ||
            !extreme(above, below, -1, &flattest)) {
            Py_RETURN_NONE;
        }
        const double high = tightest(above, steepest, -HUGE_VAL, &x);
        const double low = tightest(below, flattest, -HUGE_VAL, &x);
        centre(above, below, flattest, steepest, &slope, &middle);
        // Lines that touch may cross by rounding.
        half_ns = fmax(0, fmax(high - middle, middle - low));
        spread = fmax(0, fmax(steepest - slope, slope - flattest)) * 1e-9;
        rate = slope * 1e-9;
    }
    int64_t at_ns = 0;
    int64_t middle_ns = 0;
    if (!(fabs(middle) < 9e18) ||
        __builtin_mul_overflow(at_us, INT64_C(1000), &at_ns) ||
        __builtin_add_overflow(at_ns, reference, &middle_ns) ||
        __builtin_add_overflow(middle_ns, (int64_t)rint(middle), &middle_ns)) {
        PyErr_SetString(PyExc_OverflowError, "a time is beyond 292 years");
        return NULL;
    }
    return Py_BuildValue("(LLddd)", (long long)at_ns, (long long)middle_ns, rate,
                         half_ns, spread);
}

PyObject *core_estimate(PyObject *module, PyObject *args) {
    (void)module;
    PyObject *uppers = NULL;
    PyObject *lowers = NULL;
    long long at_us = 0;
    long long reference = 0;
    double rate = 0;
    double drift_max = 0;
    if (!PyArg_ParseTuple(args, "OOLLdd:estimate", &uppers, &lowers, &at_us, &reference,
                          &rate, &drift_max)) {
        return NULL;
    }
    struct side above = {.sign = 1};
    struct side below = {.sign = -1};
    PyObject *estimate = NULL;
    if (take_points(&above, uppers, at_us, reference, drift_max) == 0 &&
        take_points(&below, lowers, at_us, reference, drift_max) == 0) {
        estimate = estimate_of(&above, &below, at_us, reference, rate);
    }
    PyMem_Free(above.x);
    PyMem_Free(below.x);
    return estimate;
}
