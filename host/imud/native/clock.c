// SPDX-License-Identifier: MIT
// _core.Rising and _core.Line: what the clocks of probes and host are asked for each
// message. probes/clock.py and timeline.py estimate: docs/pose-details.md.
#include "module.h"

#include <math.h>

// After a step backwards, time runs at 9 / 10 of its rate until it has caught up.
#define SLOW_OF 10

// Pieces kept for times out of order.
#define PIECES 16

struct piece {
    int64_t x;  // it holds beyond
    int64_t aim;
    int64_t floor;
    double rate;
};

struct rising {
    PyObject_HEAD struct piece pieces[PIECES];  // a ring
    unsigned turns;                             // pieces so far
    int has_last;
    int64_t last;  // the greatest x so far
};

// All sums are checked: times may come from damaged bytes.
static int add(int64_t *sum, int64_t value) {
    return __builtin_add_overflow(*sum, value, sum);
}

static int subtract(int64_t from, int64_t value, int64_t *difference) {
    return __builtin_sub_overflow(from, value, difference);
}

// rate * step, rounded to nearest; not 0: out of range.
static int part_of(double rate, int64_t step, int64_t *part) {
    const double exact = rint(rate * (double)step);
    if (!(fabs(exact) < 9e18)) {
        return 1;
    }
    *part = (int64_t)exact;
    return 0;
}

// base + step + rate * step
static int on_line(int64_t base, int64_t step, double rate, int64_t *y) {
    int64_t part = 0;
    *y = base;
    return part_of(rate, step, &part) || add(y, step) || add(y, part);
}

static int out_of_range(void) {
    PyErr_SetString(PyExc_OverflowError, "a time is beyond 292 years");
    return -1;
}

static const struct piece *piece_of(const struct rising *self, int64_t x) {
    const unsigned kept = self->turns < PIECES ? self->turns : PIECES;
    const struct piece *piece = NULL;
    for (unsigned back = 1; back <= kept; back++) {
        piece = &self->pieces[(self->turns - back) % PIECES];
        if (x > piece->x) {
            break;
        }
    }
    return piece;  // the oldest for what is before all of them
}

// 0 on success, else an exception is set.
static int rising_at(struct rising *self, int64_t x, int64_t *y) {
    const struct piece *piece = piece_of(self, x);
    if (piece == NULL) {
        PyErr_SetString(PyExc_ValueError, "nothing is known yet");
        return -1;
    }
    int64_t step = 0;
    int64_t least = piece->floor;
    if (subtract(x, piece->x, &step) || on_line(piece->aim, step, piece->rate, y) ||
        add(&least, step) || add(&least, -(step / SLOW_OF + (step % SLOW_OF > 0)))) {
        return out_of_range();
    }
    if (!self->has_last || x > self->last) {
        self->has_last = 1;
        self->last = x;
    }
    *y = *y > least ? *y : least;
    return 0;
}

static int number_of(PyObject *object, int64_t *number) {
    *number = PyLong_AsLongLong(object);
    return *number == -1 && PyErr_Occurred() != NULL ? -1 : 0;
}

static PyObject *rising_method_turn(PyObject *object, PyObject *args) {
    struct rising *self = (struct rising *)object;
    long long x = 0;
    long long aim = 0;
    double rate = 0;
    if (!PyArg_ParseTuple(args, "LLd:turn", &x, &aim, &rate)) {
        return NULL;
    }
    int64_t begin = self->last;
    int64_t floor = 0;
    if (self->has_last && rising_at(self, begin, &floor) != 0) {
        return NULL;
    }
    int64_t step = 0;
    int64_t aimed = 0;
    if ((!self->has_last && subtract(x, 1, &begin)) || subtract(begin, x, &step) ||
        on_line(aim, step, rate, &aimed)) {
        out_of_range();
        return NULL;
    }
    if (!self->has_last) {
        self->turns = 0;
    }
    self->pieces[self->turns % PIECES] =
        (struct piece){begin, aimed, self->has_last ? floor : aimed, rate};
    self->turns++;
    Py_RETURN_NONE;
}

static PyObject *rising_method_at(PyObject *object, PyObject *said) {
    int64_t x = 0;
    int64_t y = 0;
    if (number_of(said, &x) != 0 || rising_at((struct rising *)object, x, &y) != 0) {
        return NULL;
    }
    return PyLong_FromLongLong(y);
}

static PyObject *rising_method_is_beyond(PyObject *object, PyObject *said) {
    const struct rising *self = (const struct rising *)object;
    int64_t x = 0;
    if (number_of(said, &x) != 0) {
        return NULL;
    }
    return PyBool_FromLong(self->has_last && self->last > x);
}

static PyMethodDef rising_methods[] = {
    {"turn", rising_method_turn, METH_VARARGS,
     "turn($self, x, aim, rate, /)\n--\n\nFrom here on aims at `aim` at x, with slope "
     "1 + rate, without going back."},
    {"at", rising_method_at, METH_O, "at($self, x, /)\n--\n\nThe value at x."},
    {"is_beyond", rising_method_is_beyond, METH_O,
     "is_beyond($self, x, /)\n--\n\nWhether it was asked for more than x."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot rising_slots[] = {
    {Py_tp_doc, "Rising()\n--\n\nA function of time that never falls, made of pieces "
                "as they become known."},
    {Py_tp_dealloc, instance_dealloc},
    {Py_tp_traverse, instance_traverse},
    {Py_tp_methods, rising_methods},
    {0, NULL},
};

PyType_Spec rising_spec = TYPE("Rising", struct rising, rising_slots);

struct line {
    PyObject_HEAD PyObject *rising;
    double drift_max;  // change of the rate a second
    int64_t quantum_ns;
    int64_t next_us;  // where the next bin begins
    int has_latest;
    int64_t then_us;  // the latest point from above
    int64_t then_ns;
    double rate;
    int has_estimate;
    int64_t at_ns;
    int64_t middle_ns;
    double estimated_rate;
    double half_ns;  // negative: there is no bound
    double spread;
};

static int device_ns_of(int64_t device_us, int64_t *device_ns) {
    return __builtin_mul_overflow(device_us, INT64_C(1000), device_ns) ? out_of_range()
                                                                       : 0;
}

static int middle_at(const struct line *self, int64_t device_ns, int64_t *middle) {
    int64_t step = 0;
    *middle = INT64_MAX;
    if (!self->has_estimate) {
        return 0;
    }
    return subtract(device_ns, self->at_ns, &step) ||
                   on_line(self->middle_ns, step, self->estimated_rate, middle)
               ? out_of_range()
               : 0;
}

// 1: an arrival can change the estimate; 0: not, as most: they come in a bin that has a
// tighter one, and later than estimated. Negative: failure.
static int is_news(const struct line *self, int64_t device_us, int64_t host_ns) {
    int64_t device_ns = 0;
    int64_t middle = 0;
    if (device_us >= self->next_us || !self->has_latest) {
        return 1;
    }
    if (device_ns_of(device_us, &device_ns) != 0 ||
        middle_at(self, device_ns, &middle) != 0) {
        return -1;
    }
    int64_t step_us = 0;
    int64_t gained_ns = 0;
    if (subtract(device_us, self->then_us, &step_us) ||
        subtract(host_ns, device_ns, &gained_ns) ||
        subtract(gained_ns, self->then_ns, &gained_ns)) {
        return out_of_range();
    }
    const double expected_ns = self->rate * (1000 * (double)step_us);
    return (double)gained_ns < expected_ns || host_ns < middle;
}

// A message was made before it arrived: `latest` is the greatest time it can have.
static PyObject *moment_of(struct line *self, int64_t device_us, int64_t latest) {
    int64_t device_ns = 0;
    int64_t host_ns = 0;
    int64_t middle = 0;
    if (device_ns_of(device_us, &device_ns) != 0 ||
        rising_at((struct rising *)self->rising, device_ns, &host_ns) != 0 ||
        middle_at(self, device_ns, &middle) != 0) {
        return NULL;
    }
    host_ns = host_ns < latest ? host_ns : latest;
    if (!self->has_estimate || self->half_ns < 0) {
        return Py_BuildValue("(LO)", (long long)host_ns, Py_None);
    }
    int64_t age_ns = 0;
    int64_t off_ns = 0;
    if (subtract(device_ns, self->at_ns, &age_ns) ||
        subtract(host_ns, middle, &off_ns)) {
        out_of_range();
        return NULL;
    }
    const double age_s = fabs((double)age_ns) * 1e-9;
    const double grown_s = self->spread * age_s + self->drift_max * age_s * age_s / 2;
    const double bound_ns = rint(self->half_ns + fabs((double)off_ns) + grown_s * 1e9);
    if (!(bound_ns < 9e18)) {
        out_of_range();
        return NULL;
    }
    return Py_BuildValue("(LL)", (long long)host_ns,
                         (long long)((int64_t)bound_ns + self->quantum_ns));
}

static PyObject *line_date(PyObject *object, PyObject *const *args, Py_ssize_t count) {
    struct line *self = (struct line *)object;
    int64_t device_us = 0;
    int64_t host_ns = 0;
    if (count != 2) {
        return PyErr_Format(PyExc_TypeError, "date() takes 2 arguments");
    }
    if (number_of(args[0], &device_us) != 0 || number_of(args[1], &host_ns) != 0) {
        return NULL;
    }
    const int news = is_news(self, device_us, host_ns);
    if (news < 0) {
        return NULL;
    }
    return news ? Py_NewRef(Py_None) : moment_of(self, device_us, host_ns);
}

static PyObject *line_moment(PyObject *object, PyObject *said) {
    int64_t device_us = 0;
    return number_of(said, &device_us) != 0
               ? NULL
               : moment_of((struct line *)object, device_us, INT64_MAX);
}

static PyObject *line_middle(PyObject *object, PyObject *said) {
    int64_t device_us = 0;
    int64_t device_ns = 0;
    int64_t middle = 0;
    if (number_of(said, &device_us) != 0 || device_ns_of(device_us, &device_ns) != 0 ||
        middle_at((const struct line *)object, device_ns, &middle) != 0) {
        return NULL;
    }
    return PyLong_FromLongLong(middle);
}

static PyObject *line_know(PyObject *object, PyObject *args) {
    struct line *self = (struct line *)object;
    long long next_us = 0;
    long long then[2] = {0};
    long long middle[2] = {0};
    double rate = 0;
    double rates[3] = {0};
    PyObject *latest = NULL;
    PyObject *estimate = NULL;
    if (!PyArg_ParseTuple(args, "LOdO:know", &next_us, &latest, &rate, &estimate)) {
        return NULL;
    }
    const int has_latest = latest != Py_None;
    if (has_latest && !PyArg_ParseTuple(latest, "LL", &then[0], &then[1])) {
        return NULL;
    }
    const int has_estimate = estimate != Py_None;
    if (has_estimate && !PyArg_ParseTuple(estimate, "LLddd", &middle[0], &middle[1],
                                          &rates[0], &rates[1], &rates[2])) {
        return NULL;
    }
    self->next_us = next_us;
    self->has_latest = has_latest;
    self->then_us = then[0];
    self->then_ns = then[1];
    self->rate = rate;
    self->has_estimate = has_estimate;
    self->at_ns = middle[0];
    self->middle_ns = middle[1];
    self->estimated_rate = rates[0];
    self->half_ns = rates[1];
    self->spread = rates[2];
    Py_RETURN_NONE;
}

static PyObject *line_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"rising", "drift_max", "quantum_ns", NULL};
    PyObject *rising = NULL;
    double drift_max = 0;
    long long quantum_ns = 0;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OdL:Line", names, &rising,
                                     &drift_max, &quantum_ns)) {
        return NULL;
    }
    if (PyType_GetSlot(Py_TYPE(rising), Py_tp_methods) != rising_methods) {
        PyErr_SetString(PyExc_TypeError, "a Line is made of a Rising");
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *object = allocate(type, 0);
    if (object == NULL) {
        return NULL;
    }
    struct line *self = (struct line *)object;
    self->rising = Py_NewRef(rising);
    self->drift_max = drift_max;
    self->quantum_ns = quantum_ns;
    return object;
}

static int line_traverse(PyObject *object, visitproc visit, void *arg) {
    Py_VISIT(((const struct line *)object)->rising);
    return instance_traverse(object, visit, arg);
}

static void line_dealloc(PyObject *object) {
    Py_CLEAR(((struct line *)object)->rising);
    instance_dealloc(object);
}

static PyMethodDef line_methods[] = {
    {"know", line_know, METH_VARARGS,
     "know($self, next_us, latest, rate, estimate, /)\n--\n\nWhere the next bin "
     "begins; "
     "the latest point from above (device time in us; host's less device's in ns) or "
     "None; the rate; the estimate (device's and host's ns, rate, half of the range in "
     "ns or -1, spread of the rate) or None."},
    {"date", (PyCFunction)(void (*)(void))line_date, METH_FASTCALL,
     "date($self, device_us, host_ns, /)\n--\n\nThe moment() of a message that arrived "
     "at `host_ns`, which is the latest it can be; None: the arrival can change the "
     "estimate."},
    {"moment", line_moment, METH_O,
     "moment($self, device_us, /)\n--\n\nThe host's time in ns, and its error bound or "
     "None."},
    {"middle", line_middle, METH_O,
     "middle($self, device_us, /)\n--\n\nThe estimate of the host's time in ns; the "
     "greatest number while there is none."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot line_slots[] = {
    {Py_tp_doc,
     "Line(rising, drift_max, quantum_ns)\n--\n\nA clock between two changes "
     "of its estimate."},
    {Py_tp_new, line_new},
    {Py_tp_dealloc, line_dealloc},
    {Py_tp_traverse, line_traverse},
    {Py_tp_methods, line_methods},
    {0, NULL},
};

PyType_Spec line_spec = TYPE("Line", struct line, line_slots);
