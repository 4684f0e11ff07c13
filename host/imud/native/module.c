// SPDX-License-Identifier: MIT
// The firmware's own C for Python: the host frames, checks and computes with the same
// functions that run on a probe. Limited API, so one build serves Python 3.11 and
// later.
#include "module.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "core/fusion/fuse_params.h"
#include "core/wire/frame.h"

// Whether a CRC seed or a message id is in its range; sets ValueError if not.
static int number_in_range(const char *name, long value, long limit) {
    if (value >= 0 && value <= limit) {
        return 1;
    }
    PyErr_Format(PyExc_ValueError, "%s must be 0 to %ld, not %ld", name, limit, value);
    return 0;
}

struct decoder {
    PyObject_HEAD struct frame_decoder frames;
    uint8_t bytes[FRAME_CONTENT_MAX + FRAME_CRC];
    unsigned long long good;
    unsigned long long bad_cobs;
    unsigned long long bad_crc;
    unsigned long long too_long;
    unsigned long long too_short;
};

static PyObject *decoder_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"seed", "hello_id", NULL};
    long seed = 0;
    long hello_id = 0;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "ll:FrameDecoder", names, &seed,
                                     &hello_id) ||
        !number_in_range("seed", seed, UINT16_MAX) ||
        !number_in_range("hello_id", hello_id, UINT8_MAX)) {
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *self = allocate(type, 0);  // all counters zero
    if (self == NULL) {
        return NULL;
    }
    struct decoder *decoder = (struct decoder *)self;
    frame_decoder_init(&decoder->frames, (uint16_t)seed, (uint8_t)hello_id,
                       decoder->bytes, sizeof decoder->bytes);
    return self;
}

int instance_traverse(PyObject *self, visitproc visit, void *arg) {
    Py_VISIT(Py_TYPE(self));
    return 0;
}

void instance_dealloc(PyObject *self) {
    PyTypeObject *type = Py_TYPE(self);
    PyObject_GC_UnTrack(self);
    const freefunc release = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release(self);
    Py_DECREF(type);
}

// Appends the content of one good frame; 0 on success, as in Python's own API.
static int append_content(PyObject *list, const uint8_t *content, uint8_t length) {
    PyObject *bytes = PyBytes_FromStringAndSize((const char *)content, length);
    if (bytes == NULL) {
        return -1;
    }
    const int failed = PyList_Append(list, bytes);
    Py_DECREF(bytes);
    return failed;
}

// Decodes one byte and counts the result; -1 when Python is out of memory.
static int decoder_take(struct decoder *self, uint8_t byte, PyObject *contents) {
    uint8_t length = 0;
    switch (frame_decode(&self->frames, byte, &length)) {
    case FRAME_OK:
        self->good++;
        return append_content(contents, self->bytes, length);
    case FRAME_BAD_COBS:
        self->bad_cobs++;
        break;
    case FRAME_BAD_CRC:
        self->bad_crc++;
        break;
    case FRAME_TOO_LONG:
        self->too_long++;
        break;
    case FRAME_TOO_SHORT:
        self->too_short++;
        break;
    case FRAME_PENDING:
        break;
    }
    return 0;
}

static PyObject *decoder_feed(PyObject *self, PyObject *data) {
    Py_buffer view;
    if (PyObject_GetBuffer(data, &view, PyBUF_SIMPLE) != 0) {
        return NULL;
    }
    PyObject *contents = PyList_New(0);
    const uint8_t *bytes = view.buf;
    for (Py_ssize_t i = 0; contents != NULL && i < view.len; i++) {
        if (decoder_take((struct decoder *)self, bytes[i], contents) != 0) {
            Py_CLEAR(contents);
        }
    }
    PyBuffer_Release(&view);
    return contents;
}

static PyObject *decoder_stats(PyObject *self, PyObject *Py_UNUSED(none)) {
    const struct decoder *decoder = (const struct decoder *)self;
    return Py_BuildValue("{s:K,s:K,s:K,s:K,s:K}", "ok", decoder->good, "bad_cobs",
                         decoder->bad_cobs, "bad_crc", decoder->bad_crc, "too_long",
                         decoder->too_long, "too_short", decoder->too_short);
}

// The total alone: it is asked for at every read.
static PyObject *decoder_bad(PyObject *self, PyObject *Py_UNUSED(none)) {
    const struct decoder *decoder = (const struct decoder *)self;
    return PyLong_FromUnsignedLongLong(decoder->bad_cobs + decoder->bad_crc +
                                       decoder->too_long + decoder->too_short);
}

static PyMethodDef decoder_methods[] = {
    {"feed", decoder_feed, METH_O,
     "feed($self, data, /)\n--\n\nTake received bytes; return the content of each good "
     "frame that they complete."},
    {"bad", decoder_bad, METH_NOARGS, "bad($self, /)\n--\n\nBad frames so far."},
    {"stats", decoder_stats, METH_NOARGS,
     "stats($self, /)\n--\n\nFrames so far, good and bad by reason."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot decoder_slots[] = {
    {Py_tp_doc, "FrameDecoder(seed, hello_id)\n--\n\nTurns received bytes into the "
                "content of frames, in chunks of any size."},
    {Py_tp_new, decoder_new},
    {Py_tp_dealloc, instance_dealloc},
    {Py_tp_traverse, instance_traverse},
    {Py_tp_methods, decoder_methods},
    {0, NULL},
};

static PyType_Spec decoder_spec = TYPE("FrameDecoder", struct decoder, decoder_slots);

static PyObject *core_crc16(PyObject *Py_UNUSED(module), PyObject *args) {
    long seed = 0;
    Py_buffer view;
    if (!PyArg_ParseTuple(args, "ly*:crc16", &seed, &view)) {
        return NULL;
    }
    PyObject *result = NULL;
    if (number_in_range("seed", seed, UINT16_MAX)) {
        uint16_t crc = (uint16_t)seed;
        const uint8_t *bytes = view.buf;
        // In blocks, because the probe counts a frame's bytes in 8 bits.
        for (Py_ssize_t left = view.len; left > 0;) {
            const uint8_t length = (uint8_t)(left < UINT8_MAX ? left : UINT8_MAX);
            crc = frame_crc(crc, bytes, length);
            bytes += length;
            left -= length;
        }
        result = PyLong_FromLong(crc);
    }
    PyBuffer_Release(&view);
    return result;
}

static PyObject *core_encode_frame(PyObject *Py_UNUSED(module), PyObject *args) {
    long seed = 0;
    Py_buffer view;
    if (!PyArg_ParseTuple(args, "ly*:encode_frame", &seed, &view)) {
        return NULL;
    }
    PyObject *result = NULL;
    if (view.len < 1 || view.len > FRAME_CONTENT_MAX) {
        PyErr_Format(PyExc_ValueError, "content must be 1 to %d bytes, not %zd",
                     FRAME_CONTENT_MAX, view.len);
    } else if (number_in_range("seed", seed, UINT16_MAX)) {
        uint8_t out[FRAME_CONTENT_MAX + FRAME_AROUND];
        memcpy(out + 1, view.buf, (size_t)view.len);
        const uint8_t length = frame_encode((uint16_t)seed, out, (uint8_t)view.len);
        result = PyBytes_FromStringAndSize((const char *)out, length);
    }
    PyBuffer_Release(&view);
    return result;
}

// More than a kernel's serial buffer holds.
#define READ_MAX 65536

static PyObject *core_read_some(PyObject *module, PyObject *descriptor) {
    (void)module;
    static char buffer[READ_MAX];  // the GIL is held
    const int file = PyObject_AsFileDescriptor(descriptor);
    if (file < 0) {
        return NULL;
    }
    const ssize_t count = read(file, buffer, sizeof buffer);
    if (count >= 0) {
        return PyBytes_FromStringAndSize(buffer, count);
    }
    if (errno == EAGAIN || errno == EINTR) {
        Py_RETURN_NONE;
    }
    return PyErr_SetFromErrno(PyExc_OSError);
}

static PyMethodDef core_functions[] = {
    {"crc16", core_crc16, METH_VARARGS,
     "crc16(seed, data, /)\n--\n\nThe CRC of data; `seed` is the CRC of what precedes "
     "it."},
    {"encode_frame", core_encode_frame, METH_VARARGS,
     "encode_frame(seed, content, /)\n--\n\nThe frame of content, delimiter included."},
    {"estimate", core_estimate, METH_VARARGS,
     "estimate(above, below, at_us, reference, rate, drift_max, /)\n--\n\nThe middle "
     "of "
     "all lines between points from above and from below (device time in us; host's "
     "less device's in ns): device's and host's ns, rate, half of the range there in "
     "ns "
     "or -1, spread of the rate. None: there is no such line. A steeper line can be "
     "higher: the highest value belongs to the steepest line, the lowest to the "
     "flattest. The rate may have changed by `drift_max` a second."},
    {"read_some", core_read_some, METH_O,
     "read_some(descriptor, /)\n--\n\nRead a descriptor that does not block: at most "
     "64 KiB, b'' at its end, None if nothing is there yet."},
    {NULL, NULL, 0, NULL},
};

static int add_type(PyObject *module, const char *name, PyType_Spec *spec) {
    PyObject *type = PyType_FromModuleAndSpec(module, spec, NULL);
    if (type == NULL) {
        return -1;
    }
    const int failed = PyModule_AddObjectRef(module, name, type);
    Py_DECREF(type);
    return failed;
}

static int add_number(PyObject *module, const char *name, double value) {
    PyObject *number = PyFloat_FromDouble(value);
    if (number == NULL) {
        return -1;
    }
    const int failed = PyModule_AddObjectRef(module, name, number);
    Py_DECREF(number);
    return failed;
}

static int core_exec(PyObject *module) {
    return add_type(module, "FrameDecoder", &decoder_spec) != 0 ||
                   add_type(module, "Calibrator", &calibrator_spec) != 0 ||
                   add_type(module, "Chunk", &chunk_spec) != 0 ||
                   add_type(module, "Line", &line_spec) != 0 ||
                   add_type(module, "Reader", &reader_spec) != 0 ||
                   add_type(module, "Replay", &replay_spec) != 0 ||
                   add_type(module, "Rising", &rising_spec) != 0 ||
                   PyModule_AddIntConstant(module, "CONTENT_MAX", FRAME_CONTENT_MAX) ||
                   PyModule_AddIntConstant(module, "HELLO_SEED", FRAME_HELLO_SEED) ||
                   add_number(module, "TILT_FLOOR_DEG", FUSE_TILT_FLOOR_DEG) != 0 ||
                   add_number(module, "LEVEL_SIGMA_G", FUSE_LEVEL_SIGMA_G) != 0 ||
                   PyModule_AddStringConstant(module, "SOURCES", IMUD_SOURCES)
               ? -1
               : 0;
}

static PyModuleDef_Slot core_slots[] = {
    {Py_mod_exec, core_exec},
    {0, NULL},
};

static struct PyModuleDef core_module = {
    PyModuleDef_HEAD_INIT,
    .m_name = "imud._core",
    .m_doc = "The firmware's portable C.",
    .m_size = 0,
    .m_methods = core_functions,
    .m_slots = core_slots,
};

PyMODINIT_FUNC PyInit__core(void) {
    return PyModuleDef_Init(&core_module);
}
