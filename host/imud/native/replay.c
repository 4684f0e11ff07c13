// SPDX-License-Identifier: MIT
// _core.Replay: computes a probe's poses again from its raw messages.
#include "inputs.h"

#include <string.h>

#include "core/fusion/pose.h"
#include "core/wire/messages.h"

struct replay {
    PyObject_HEAD struct sensor_identity identity;
    struct params params;  // whose calibration the tracker works with
    struct params next;    // from the next begin on
    struct own_field own;  // of the probe, as its hello tells
    struct pose_tracker tracker;
    bool has_strokes;  // the probe's build has: there is no room on a Nano
};

// The tip, and what the button does, as the probe puts them in force.
static void use_tip(struct replay *replay, const struct params *params) {
    pose_set_tip(&replay->tracker, &params->tip,
                 params->button_does == BUTTON_DOES_STROKE);
}

static bool begin(struct replay *replay, long filter) {
    const struct params before = replay->params;
    replay->params = replay->next;
    if (filter < 0 || filter > UINT8_MAX ||
        !pose_begin(&replay->tracker, &replay->params.calibration, &replay->identity,
                    (int32_t)filter)) {
        replay->params = before;
        PyErr_Format(PyExc_ValueError, "filter %ld is not one that can be replayed",
                     filter);
        return false;
    }
    pose_use_own(&replay->tracker, &replay->own);
    use_tip(replay, &replay->params);
    return true;
}

static PyObject *replay_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    struct sensor_identity identity;
    struct params params;
    struct message_hello hello;
    if (!probe_of_arguments(args, kwargs, "O|O:Replay", &identity, &hello, &params)) {
        return NULL;
    }
    if (identity.rate_hz < 100 || identity.rate_hz > 800) {
        PyErr_Format(PyExc_ValueError, "no filter runs at %d Hz", identity.rate_hz);
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *self = allocate(type, 0);
    if (self == NULL) {
        return NULL;
    }
    struct replay *replay = (struct replay *)self;
    replay->identity = identity;
    replay->next = params;
    memcpy(replay->own.axis, hello.own_field, sizeof replay->own.axis);
    replay->own.sigma = hello.own_sigma;
    replay->has_strokes = hello.board != BOARD_NANO;
    if (!begin(replay, hello.filter)) {
        Py_DECREF(self);
        return NULL;
    }
    return self;
}

static PyObject *replay_step(PyObject *self, PyObject *content) {
    struct sample sample;
    if (!sample_of_raw(content, &sample)) {
        return NULL;
    }
    (void)pose_step(&((struct replay *)self)->tracker, &sample);
    Py_RETURN_NONE;
}

static PyObject *replay_params(PyObject *self, PyObject *records) {
    struct replay *replay = (struct replay *)self;
    struct params params;
    if (!params_of_records(records, &params)) {
        return NULL;
    }
    replay->next = params;
    use_tip(replay, &params);
    // As the probe decides whether its filter has to restart, without what it kept of
    // its own field with the other calibration.
    const bool is_other = params.digest != replay->params.digest;
    if (is_other) {
        replay->own.sigma = 0;
    }
    return PyBool_FromLong(is_other);
}

static PyObject *replay_go_on(PyObject *self, PyObject *Py_UNUSED(none)) {
    struct replay *replay = (struct replay *)self;
    replay->params = replay->next;
    pose_recalibrate(&replay->tracker);
    use_tip(replay, &replay->params);
    Py_RETURN_NONE;
}

static PyObject *replay_pose(PyObject *self, PyObject *args) {
    unsigned long sequence = 0;
    unsigned long time_us = 0;
    uint8_t content[MESSAGE_CONTENT_MAX];
    struct message_pose pose;
    if (!PyArg_ParseTuple(args, "kk:pose", &sequence, &time_us)) {
        return NULL;
    }
    struct replay *replay = (struct replay *)self;
    pose_read(&replay->tracker, &pose);
    for (int axis = 0; axis < 3 && !replay->has_strokes; ++axis) {
        pose.position[axis] = POSE_POSITION_NULL;
        pose.normal[axis] = POSE_NORMAL_NULL;
    }
    const uint8_t length =
        message_pose_encode(&pose, (uint32_t)sequence, (uint32_t)time_us, content);
    return PyBytes_FromStringAndSize((const char *)content, length);
}

static PyObject *replay_restart(PyObject *self, PyObject *filter) {
    const long kind = PyLong_AsLong(filter);
    if (PyErr_Occurred() || !begin((struct replay *)self, kind)) {
        return NULL;
    }
    Py_RETURN_NONE;
}

static PyObject *replay_origin(PyObject *self, PyObject *kind) {
    const long origin = PyLong_AsLong(kind);
    if (PyErr_Occurred()) {
        return NULL;
    }
    if (origin < POSE_ORIGIN_FULL || origin > POSE_ORIGIN_NONE) {
        PyErr_Format(PyExc_ValueError, "origin %ld is not one of 0 to 2", origin);
        return NULL;
    }
    pose_set_origin(&((struct replay *)self)->tracker, (enum pose_origin)origin);
    Py_RETURN_NONE;
}

static PyObject *replay_stroke(PyObject *self, PyObject *args) {
    unsigned long sequence = 0;
    unsigned long time_us = 0;
    uint8_t content[MESSAGE_CONTENT_MAX];
    struct message_stroke stroke;
    struct replay *replay = (struct replay *)self;
    if (!PyArg_ParseTuple(args, "kk:stroke", &sequence, &time_us)) {
        return NULL;
    }
    if (!pose_read_stroke(&replay->tracker, &stroke) || !replay->has_strokes) {
        Py_RETURN_NONE;
    }
    const uint8_t length =
        message_stroke_encode(&stroke, (uint32_t)sequence, (uint32_t)time_us, content);
    return PyBytes_FromStringAndSize((const char *)content, length);
}

static PyObject *replay_hold(PyObject *self, PyObject *is_held) {
    const int held = PyObject_IsTrue(is_held);
    if (held < 0) {
        return NULL;
    }
    pose_hold(&((struct replay *)self)->tracker, held != 0);
    Py_RETURN_NONE;
}

static PyObject *replay_is_by_button(PyObject *self, PyObject *Py_UNUSED(none)) {
    return PyBool_FromLong(((struct replay *)self)->tracker.stroke.is_by_button);
}

static PyMethodDef replay_methods[] = {
    {"step", replay_step, METH_O,
     "step($self, raw, /)\n--\n\nTake the content of the next raw message."},
    {"pose", replay_pose, METH_VARARGS,
     "pose($self, sequence, time_us, /)\n--\n\nThe content of the pose message that "
     "the probe sends after the last step, the same in every bit."},
    {"params", replay_params, METH_O,
     "params($self, records, /)\n--\n\nPut other params in force: a tip and "
     "what the button does at once, a calibration from the next restart on, or from "
     "go_on() on. Whether they calibrate otherwise than those of the last."},
    {"go_on", replay_go_on, METH_NOARGS,
     "go_on($self, /)\n--\n\nWith the calibration of the last params(), as the probe "
     "does when it changes them and sends no event `restarted`."},
    {"origin", replay_origin, METH_O,
     "origin($self, kind, /)\n--\n\nSet the origin, as the probe does when it sends "
     "the event `tared` with that detail."},
    {"stroke", replay_stroke, METH_VARARGS,
     "stroke($self, sequence, time_us, /)\n--\n\nThe content of the stroke message "
     "that the probe sends after the last step, None where it sends none. Once for "
     "each "
     "step: a second call gives None."},
    {"hold", replay_hold, METH_O,
     "hold($self, is_held, /)\n--\n\nThe button is pressed or released, as the probe "
     "says in its events. Matters where the params let it be held for strokes."},
    {"is_by_button", replay_is_by_button, METH_NOARGS,
     "is_by_button($self, /)\n--\n\nWhether strokes are what the button is held for."},
    {"restart", replay_restart, METH_O,
     "restart($self, filter, /)\n--\n\nStart again, as the probe does when it sends "
     "the event `restarted` with that filter."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot replay_slots[] = {
    {Py_tp_doc,
     "Replay(hello, params=b'')\n--\n\nComputes a probe's poses again from its hello, "
     "the records of its params and all raw messages since its filter began."},
    {Py_tp_new, replay_new},
    {Py_tp_dealloc, instance_dealloc},
    {Py_tp_traverse, instance_traverse},
    {Py_tp_methods, replay_methods},
    {0, NULL},
};

PyType_Spec replay_spec = TYPE("Replay", struct replay, replay_slots);
