// SPDX-License-Identifier: MIT
// _core.Replay: computes a probe's poses again from its raw messages.
#include "_inputs.h"

#include "core/fusion/pose.h"
#include "core/wire/messages.h"

struct replay {
    PyObject_HEAD struct sensor_identity identity;
    struct params params;  // whose calibration the tracker works with
    struct params next;    // from the next begin on
    struct pose_tracker tracker;
};

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
    return true;
}

static PyObject *replay_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    struct sensor_identity identity;
    struct params params;
    uint8_t filter;
    if (!probe_of_arguments(args, kwargs, "O|O:Replay", &identity, &filter, &params)) {
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
    if (!begin(replay, filter)) {
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
    // As the probe tells whether its filter has to begin anew.
    return PyBool_FromLong(params.digest != replay->params.digest);
}

static PyObject *replay_pose(PyObject *self, PyObject *args) {
    unsigned long sequence = 0;
    unsigned long time_us = 0;
    uint8_t content[MESSAGE_CONTENT_MAX];
    struct message_pose pose;
    if (!PyArg_ParseTuple(args, "kk:pose", &sequence, &time_us)) {
        return NULL;
    }
    pose_read(&((struct replay *)self)->tracker, &pose);
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

static PyMethodDef replay_methods[] = {
    {"step", replay_step, METH_O,
     "step($self, raw, /)\n--\n\nTake the content of the next raw message."},
    {"pose", replay_pose, METH_VARARGS,
     "pose($self, sequence, time_us, /)\n--\n\nThe content of the pose message that "
     "the probe sends after the last step, the same in every bit."},
    {"params", replay_params, METH_O,
     "params($self, records, /)\n--\n\nPut other params in force, from the next "
     "restart on. Whether they calibrate otherwise than those of the last."},
    {"origin", replay_origin, METH_O,
     "origin($self, kind, /)\n--\n\nSet the origin, as the probe does when it sends "
     "the event `tared` with that detail."},
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

PyType_Spec replay_spec = {
    .name = "imud._core.Replay",
    .basicsize = sizeof(struct replay),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = replay_slots,
};
