// SPDX-License-Identifier: MIT
// _core.Chunk: the messages of an MCAP chunk and their indexes, as
// https://mcap.dev/spec has them; log/writer.py writes what surrounds them.
#include "module.h"

#include <string.h>

enum { OP_MESSAGE = 0x05, OP_MESSAGE_INDEX = 0x07 };

#define PREFIX 9             // of a record: opcode, length of what follows
#define MESSAGE_HEAD 22      // channel, sequence, log time, publish time
#define INDEX_HEAD 6         // channel, bytes of the entries
#define INDEX_ENTRY 16       // log time, offset in the chunk
#define CHANNEL_MAX 0xFFFF   // of a channel's number
#define BUFFER_MIN (1 << 8)  // bytes

struct buffer {
    uint8_t *bytes;
    size_t size;
    size_t capacity;
};

struct index {
    struct buffer entries;
    uint32_t channel;
};

struct chunk {
    PyObject_HEAD struct buffer data;
    struct index *indexes;  // of channels with messages, in the order of their first
    size_t used;
    size_t count;     // allocated
    uint16_t *place;  // by channel: where its index is, plus one; 0: nowhere
    uint64_t first;   // log times
    uint64_t last;
};

static uint8_t *put_number(uint8_t *at, uint64_t value, int size) {
    for (int i = 0; i < size; i++) {
        *at++ = (uint8_t)(value >> (8 * i));
    }
    return at;
}

// Room for `size` bytes at the end, counted as used. NULL: out of memory.
static uint8_t *extend(struct buffer *buffer, size_t size) {
    const size_t needed = buffer->size + size;
    if (needed > buffer->capacity) {
        size_t capacity = 2 * buffer->capacity;
        capacity = capacity < BUFFER_MIN ? BUFFER_MIN : capacity;
        capacity = capacity < needed ? needed : capacity;
        uint8_t *bytes = PyMem_Realloc(buffer->bytes, capacity);
        if (bytes == NULL) {
            return NULL;
        }
        buffer->bytes = bytes;
        buffer->capacity = capacity;
    }
    uint8_t *at = buffer->bytes + buffer->size;
    buffer->size = needed;
    return at;
}

static struct index *index_of(struct chunk *self, uint32_t channel) {
    if (self->place[channel] != 0) {
        return &self->indexes[self->place[channel] - 1];
    }
    if (self->used == self->count) {
        const size_t count = 2 * self->count + 4;
        struct index *more =
            PyMem_Realloc(self->indexes, count * sizeof *self->indexes);
        if (more == NULL) {
            return NULL;
        }
        memset(more + self->count, 0, (count - self->count) * sizeof *more);
        self->indexes = more;
        self->count = count;
    }
    struct index *index = &self->indexes[self->used++];
    index->channel = channel;
    self->place[channel] = (uint16_t)self->used;
    return index;
}

// 0 on success.
static int add_message(struct chunk *self, uint32_t channel, uint32_t sequence,
                       uint64_t log_time, uint64_t publish_time,
                       const Py_buffer *said) {
    const size_t length = (size_t)said->len;
    const size_t offset = self->data.size;
    struct index *index = index_of(self, channel);
    uint8_t *at = extend(&self->data, PREFIX + MESSAGE_HEAD + length);
    if (index == NULL || at == NULL) {
        self->data.size = offset;
        return -1;
    }
    uint8_t *entry = extend(&index->entries, INDEX_ENTRY);
    if (entry == NULL) {
        self->data.size = offset;
        return -1;
    }
    put_number(put_number(entry, log_time, 8), offset, 8);
    at = put_number(at, OP_MESSAGE, 1);
    at = put_number(at, MESSAGE_HEAD + length, 8);
    at = put_number(at, channel, 2);
    at = put_number(at, sequence, 4);
    at = put_number(at, log_time, 8);
    at = put_number(at, publish_time, 8);
    memcpy(at, said->buf, length);
    self->first = log_time < self->first ? log_time : self->first;
    self->last = log_time > self->last ? log_time : self->last;
    return 0;
}

static PyObject *chunk_add(PyObject *object, PyObject *const *args, Py_ssize_t count) {
    struct chunk *self = (struct chunk *)object;
    if (count != 5) {
        return PyErr_Format(PyExc_TypeError, "add() takes 5 arguments, not %zd", count);
    }
    const unsigned long channel = PyLong_AsUnsignedLong(args[0]);
    const uint64_t log_time = PyLong_AsUnsignedLongLong(args[1]);
    const uint64_t publish_time = PyLong_AsUnsignedLongLong(args[3]);
    const unsigned long sequence = PyLong_AsUnsignedLong(args[4]);
    if (PyErr_Occurred() != NULL) {
        return NULL;
    }
    if (channel > CHANNEL_MAX || sequence > UINT32_MAX) {
        PyErr_SetString(PyExc_OverflowError, "16 bits of channel, 32 of sequence");
        return NULL;
    }
    Py_buffer said;
    if (PyObject_GetBuffer(args[2], &said, PyBUF_SIMPLE) != 0) {
        return NULL;
    }
    const int failed = add_message(self, (uint32_t)channel, (uint32_t)sequence,
                                   log_time, publish_time, &said);
    PyBuffer_Release(&said);
    return failed ? PyErr_NoMemory() : PyLong_FromSize_t(self->data.size);
}

static PyObject *chunk_add_record(PyObject *object, PyObject *record) {
    struct chunk *self = (struct chunk *)object;
    char *bytes = NULL;
    Py_ssize_t length = 0;
    if (PyBytes_AsStringAndSize(record, &bytes, &length) != 0) {
        return NULL;
    }
    uint8_t *at = extend(&self->data, (size_t)length);
    if (at == NULL) {
        return PyErr_NoMemory();
    }
    memcpy(at, bytes, (size_t)length);
    Py_RETURN_NONE;
}

// (channel, messages, the record of its index)
static PyObject *said_of(const struct index *index) {
    const size_t size = index->entries.size;
    PyObject *record =
        PyBytes_FromStringAndSize(NULL, (Py_ssize_t)(PREFIX + INDEX_HEAD + size));
    if (record == NULL) {
        return NULL;
    }
    uint8_t *at = (uint8_t *)PyBytes_AsString(record);
    at = put_number(at, OP_MESSAGE_INDEX, 1);
    at = put_number(at, INDEX_HEAD + size, 8);
    at = put_number(at, index->channel, 2);
    at = put_number(at, size, 4);
    memcpy(at, index->entries.bytes, size);
    return Py_BuildValue("(knN)", (unsigned long)index->channel,
                         (Py_ssize_t)(size / INDEX_ENTRY), record);
}

static void clear(struct chunk *self) {
    for (size_t i = 0; i < self->used; i++) {
        self->place[self->indexes[i].channel] = 0;
        self->indexes[i].entries.size = 0;
    }
    self->used = 0;
    self->data.size = 0;
    self->first = UINT64_MAX;
    self->last = 0;
}

static PyObject *chunk_take(PyObject *object, PyObject *unused) {
    (void)unused;
    struct chunk *self = (struct chunk *)object;
    if (self->used == 0) {
        Py_RETURN_NONE;  // what else there is waits for a first message
    }
    PyObject *indexes = PyTuple_New((Py_ssize_t)self->used);
    for (size_t i = 0; indexes != NULL && i < self->used; i++) {
        PyObject *said = said_of(&self->indexes[i]);
        if (said == NULL) {
            Py_CLEAR(indexes);
        } else {
            PyTuple_SetItem(indexes, (Py_ssize_t)i, said);
        }
    }
    if (indexes == NULL) {
        return NULL;
    }
    PyObject *taken =
        Py_BuildValue("(y#KKN)", (char *)self->data.bytes, (Py_ssize_t)self->data.size,
                      self->first, self->last, indexes);
    if (taken != NULL) {
        clear(self);
    }
    return taken;
}

static PyObject *chunk_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {NULL};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, ":Chunk", names)) {
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *object = allocate(type, 0);
    if (object == NULL) {
        return NULL;
    }
    struct chunk *self = (struct chunk *)object;
    self->place = PyMem_Calloc(CHANNEL_MAX + 1, sizeof *self->place);
    if (self->place == NULL) {
        Py_DECREF(object);
        return PyErr_NoMemory();
    }
    clear(self);
    return object;
}

static void chunk_dealloc(PyObject *object) {
    struct chunk *self = (struct chunk *)object;
    for (size_t i = 0; i < self->count; i++) {
        PyMem_Free(self->indexes[i].entries.bytes);
    }
    PyMem_Free(self->indexes);
    PyMem_Free(self->place);
    PyMem_Free(self->data.bytes);
    instance_dealloc(object);
}

static PyMethodDef chunk_methods[] = {
    {"add", (PyCFunction)(void (*)(void))chunk_add, METH_FASTCALL,
     "add($self, channel, log_time, data, publish_time, sequence, /)\n--\n\nAdds a "
     "message; returns the size of the chunk in bytes."},
    {"add_record", chunk_add_record, METH_O,
     "add_record($self, record, /)\n--\n\nAdds another record."},
    {"take", chunk_take, METH_NOARGS,
     "take($self, /)\n--\n\nThe data, the first and the last log time, and of each "
     "channel its number, its messages and the record of their index. Begins another "
     "chunk. None while there is no message."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot chunk_slots[] = {
    {Py_tp_doc, "Chunk()\n--\n\nThe messages of an MCAP chunk and their indexes."},
    {Py_tp_new, chunk_new},
    {Py_tp_dealloc, chunk_dealloc},
    {Py_tp_traverse, instance_traverse},
    {Py_tp_methods, chunk_methods},
    {0, NULL},
};

PyType_Spec chunk_spec = TYPE("Chunk", struct chunk, chunk_slots);
