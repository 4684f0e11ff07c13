// SPDX-License-Identifier: MIT
// Messages and records that Python hands over, as the structs that the firmware's
// functions take. Each function sets ValueError and returns false for what it can't
// use.
#include "inputs.h"

#include "core/drivers/delays.h"
#include "core/params/store.h"
#include "core/storage/crc32.h"

// The largest scales that calibrate() has room for, 1.26 as it counts them.
#define GYR_LSB_MAX UINT32_C(1230468)   // nrad/s
#define ACC_LSB_MAX UINT32_C(19687500)  // nm/s2
#define MAG_LSB_MAX UINT32_C(157500)    // pT

// Decodes a message with its own decoder from any bytes of Python's; false with an
// exception where they are no buffer, `is_good` says whether they are that message.
#define DECODE(decode, content, header, out, is_good)                                  \
    do {                                                                               \
        Py_buffer view;                                                                \
        if (PyObject_GetBuffer(content, &view, PyBUF_SIMPLE) != 0) {                   \
            return false;                                                              \
        }                                                                              \
        is_good = view.len <= UINT8_MAX &&                                             \
                  decode(view.buf, (uint8_t)view.len, header, out) == MESSAGE_OK;      \
        PyBuffer_Release(&view);                                                       \
    } while (0)

static bool identity_of_hello(PyObject *content, struct sensor_identity *identity,
                              struct message_hello *hello) {
    struct message_header header;
    bool is_hello;
    DECODE(message_hello_decode, content, &header, hello, is_hello);
    if (!is_hello || hello->sample_rate == 0) {
        PyErr_SetString(PyExc_ValueError, "not the hello of a probe whose sensor runs");
        return false;
    }
    *identity = (struct sensor_identity){
        .kind = hello->sensor,
        .who_am_i = {hello->who_am_i[0]},
        .rate_hz = hello->sample_rate,
        .gyr_lsb_nrad_s = hello->gyr_lsb,
        .acc_lsb_nm_s2 = hello->acc_lsb,
        .mag_lsb_pt = hello->mag_lsb,
    };
    if (!delays_of_kind(identity)) {
        PyErr_Format(PyExc_ValueError, "sensor %d is not one that can be replayed",
                     hello->sensor);
        return false;
    }
    if (hello->who_am_i[0] == 0) {  // it is not known which chip it was
        identity->gyr_delay_us = identity->mag_lag_us = 0;
    }
    if (hello->gyr_lsb > GYR_LSB_MAX || hello->acc_lsb > ACC_LSB_MAX ||
        hello->mag_lsb > MAG_LSB_MAX) {
        PyErr_SetString(PyExc_ValueError, "its scales are beyond those of any sensor");
        return false;
    }
    return true;
}

static uint8_t byte_of(void *records, uint16_t at) {
    return ((const uint8_t *)records)[at];
}

bool params_of_records(PyObject *records, struct params *params) {
    static const char *const faults[] = {
        [PARAMS_WRONG_LENGTH] = "is too short or cut off",
        [PARAMS_OUT_OF_RANGE] = "has a value out of range",
        [PARAMS_DOUBLED] = "is given twice",
    };
    Py_buffer view;
    if (PyObject_GetBuffer(records, &view, PyBUF_SIMPLE) != 0) {
        return false;
    }
    const Py_ssize_t length = view.len;
    enum params_fault fault = PARAMS_FINE;
    uint8_t tag = 0;
    if (length <= PARAMS_ROOM) {
        const struct memory memory = {.read = byte_of, .port = view.buf};
        fault = params_read(&memory, 0, (uint8_t)length, params, &tag);
    }
    PyBuffer_Release(&view);
    if (length > PARAMS_ROOM) {
        PyErr_Format(PyExc_ValueError, "params of %zd bytes; a probe has room for %d",
                     length, PARAMS_ROOM);
        return false;
    }
    if (fault != PARAMS_FINE) {
        PyErr_Format(PyExc_ValueError, "record %d of the params %s", tag,
                     faults[fault]);
        return false;
    }
    return true;
}

// The digest of records that are known to be a buffer.
static uint32_t digest_of(PyObject *records) {
    Py_buffer view;
    uint32_t digest = 0;
    if (PyObject_GetBuffer(records, &view, PyBUF_SIMPLE) == 0) {
        for (Py_ssize_t i = 0; i < view.len; ++i) {
            crc32_add(&digest, ((const uint8_t *)view.buf)[i]);
        }
        PyBuffer_Release(&view);
    }
    return digest;
}

bool probe_of_arguments(PyObject *args, PyObject *kwargs, const char *format,
                        struct sensor_identity *identity, struct message_hello *hello,
                        struct params *params) {
    static char *names[] = {"hello", "params", NULL};
    PyObject *content = NULL;
    PyObject *records = NULL;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, format, names, &content, &records) ||
        !identity_of_hello(content, identity, hello)) {
        return false;
    }
    if (records == NULL ? hello->params_digest != 0
                        : hello->params_digest != digest_of(records)) {
        hello->own_sigma = 0;  // it goes with other params
    }
    if (records != NULL) {
        return params_of_records(records, params);
    }
    const struct memory none = {0};
    uint8_t tag;
    return params_read(&none, 0, 0, params, &tag) == PARAMS_FINE;
}

static struct counts counts_of(const int16_t values[3]) {
    return (struct counts){.x = values[0], .y = values[1], .z = values[2]};
}

bool sample_of_raw(PyObject *content, struct sample *sample) {
    struct message_header header;
    struct message_raw raw;
    bool is_raw;
    DECODE(message_raw_decode, content, &header, &raw, is_raw);
    if (!is_raw) {
        PyErr_SetString(PyExc_ValueError, "not a raw message");
        return false;
    }
    const bool has_mag = raw.mag[0] != RAW_MAG_NULL;
    *sample = (struct sample){
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
    return true;
}
