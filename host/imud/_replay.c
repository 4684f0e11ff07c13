// SPDX-License-Identifier: MIT
// _core.Replay: computes a probe's poses again from its raw messages.
#include "_module.h"

#include "core/drivers/lsm9ds0.h"
#include "core/drivers/mpu9250.h"
#include "core/fusion/pose.h"
#include "core/wire/messages.h"

struct replay {
    PyObject_HEAD struct sensor_identity identity;
    struct calibration calibration;
    struct pose_tracker tracker;
};

static bool begin(struct replay *replay, long filter) {
    if (filter < 0 || filter > UINT8_MAX ||
        !pose_begin(&replay->tracker, &replay->calibration, &replay->identity,
                    (int32_t)filter)) {
        PyErr_Format(PyExc_ValueError, "filter %ld is not one that can be replayed",
                     filter);
        return false;
    }
    return true;
}

// The delay of a sensor's rates, which no message carries. False for a kind of sensor
// without a driver here.
static bool gyr_delay_of(uint8_t sensor, uint16_t *delay_us) {
    switch (sensor) {
    case SENSOR_MPU9250:
    case SENSOR_MPU6500:
        *delay_us = MPU9250_GYR_DELAY_US;
        return true;
    case SENSOR_LSM9DS0:
        *delay_us = LSM9DS0_GYR_DELAY_US;
        return true;
    default:
        return false;
    }
}

static PyObject *replay_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"hello", NULL};
    Py_buffer view;
    struct message_header header;
    struct message_hello hello;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "y*:Replay", names, &view)) {
        return NULL;
    }
    const bool is_hello =
        view.len <= UINT8_MAX && message_hello_decode(view.buf, (uint8_t)view.len,
                                                      &header, &hello) == MESSAGE_OK;
    PyBuffer_Release(&view);
    if (!is_hello || hello.sample_rate < 100 || hello.sample_rate > 800) {
        PyErr_SetString(PyExc_ValueError, "not the hello of a probe whose sensor runs");
        return NULL;
    }
    uint16_t gyr_delay_us = 0;
    if (!gyr_delay_of(hello.sensor, &gyr_delay_us)) {
        PyErr_Format(PyExc_ValueError, "sensor %d is not one that can be replayed",
                     hello.sensor);
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *self = allocate(type, 0);
    if (self == NULL) {
        return NULL;
    }
    struct replay *replay = (struct replay *)self;
    replay->identity = (struct sensor_identity){
        .kind = hello.sensor,
        .rate_hz = hello.sample_rate,
        .gyr_delay_us = gyr_delay_us,
        .gyr_lsb_nrad_s = hello.gyr_lsb,
        .acc_lsb_nm_s2 = hello.acc_lsb,
        .mag_lsb_pt = hello.mag_lsb,
    };
    calibration_clear(&replay->calibration);
    if (!begin(replay, hello.filter)) {
        Py_DECREF(self);
        return NULL;
    }
    return self;
}

static struct counts counts_of(const int16_t values[3]) {
    return (struct counts){.x = values[0], .y = values[1], .z = values[2]};
}

static PyObject *replay_step(PyObject *self, PyObject *content) {
    Py_buffer view;
    struct message_header header;
    struct message_raw raw;
    if (PyObject_GetBuffer(content, &view, PyBUF_SIMPLE) != 0) {
        return NULL;
    }
    const bool is_raw =
        view.len <= UINT8_MAX &&
        message_raw_decode(view.buf, (uint8_t)view.len, &header, &raw) == MESSAGE_OK;
    PyBuffer_Release(&view);
    if (!is_raw) {
        PyErr_SetString(PyExc_ValueError, "not a raw message");
        return NULL;
    }
    const bool has_mag = raw.mag[0] != RAW_MAG_NULL;
    const struct sample sample = {
        .time_us = header.time_us,
        .acc = counts_of(raw.acc),
        .gyr = counts_of(raw.gyr),
        .mag = has_mag ? counts_of(raw.mag) : (struct counts){.x = 0},
        .temperature_cdeg = raw.temperature,
        .has_mag = has_mag,
        .mag_overflow = (raw.sample_flags & SAMPLE_MAG_OVERFLOW) != 0,
        .acc_clipped = (raw.sample_flags & SAMPLE_ACC_CLIPPED) != 0,
        .gyr_clipped = (raw.sample_flags & SAMPLE_GYR_CLIPPED) != 0,
        .has_gap = (raw.sample_flags & SAMPLE_GAP) != 0,
    };
    (void)pose_step(&((struct replay *)self)->tracker, &sample);
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
     "Replay(hello)\n--\n\nComputes a probe's poses again from its hello and "
     "all raw messages since its sensor started."},
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
