// SPDX-License-Identifier: MIT
// _core.Reader: the numbers in the content of a message as values. It takes what
// wire/fields.py says of each field and reads what fits; the rest is left to that file.
#include "module.h"

#include <math.h>
#include <string.h>

#define HEADER_SIZE 9  // id, sequence, time_us

struct reader_field {
    PyObject *name;
    PyObject *table;  // values by number; NULL: the number counts
    double by;
    double unit_tolerance;  // of the norm of all values; 0: none
    long long null;
    int has_null;
    int is_divided;  // by `by`; else it is multiplied
    int is_scaled;
    int is_signed;
    int size;  // bytes of one number
    int count;
    uint8_t tag;
};

struct reader {
    PyObject_HEAD struct reader_field *fields;
    Py_ssize_t count;
    Py_ssize_t size;  // of the content
};

static uint64_t bytes_at(const uint8_t *bytes, int size) {
    uint64_t value = 0;
    for (int i = 0; i < size; i++) {
        value |= (uint64_t)bytes[i] << (8 * i);
    }
    return value;
}

static long long number_at(const struct reader_field *field, const uint8_t *bytes) {
    const uint64_t value = bytes_at(bytes, field->size);
    const uint64_t sign = UINT64_C(1) << (8 * field->size - 1);
    if (!field->is_signed || (value & sign) == 0) {
        return (long long)value;
    }
    return (long long)(value & (sign - 1)) - (long long)(sign - 1) - 1;
}

static PyObject *value_of(const struct reader_field *field, long long number) {
    if (!field->is_scaled) {
        return PyLong_FromLongLong(number);
    }
    const double wire = (double)number;
    return PyFloat_FromDouble(field->is_divided ? wire / field->by : wire * field->by);
}

// Whether values that should be a unit vector surely are one.
static int is_unit(const struct reader_field *field, const long long *numbers) {
    double sum = 0;
    for (int i = 0; i < field->count; i++) {
        const double wire = (double)numbers[i];
        const double value = field->is_divided ? wire / field->by : wire * field->by;
        sum += value * value;
    }
    // Half of it: what is near the limit is left to Python.
    return fabs(sqrt(sum) - 1) < field->unit_tolerance / 2;
}

#define COUNT_MAX 16  // numbers in one field

static PyObject *tuple_of(const struct reader_field *field, const long long *numbers) {
    PyObject *tuple = PyTuple_New(field->count);
    for (int i = 0; tuple != NULL && i < field->count; i++) {
        PyObject *value = value_of(field, numbers[i]);
        if (value == NULL) {
            Py_CLEAR(tuple);
        } else {
            PyTuple_SetItem(tuple, i, value);
        }
    }
    return tuple;
}

// A new reference. NULL without an exception: left to Python.
static PyObject *read_field(const struct reader_field *field, const uint8_t *bytes) {
    long long numbers[COUNT_MAX];
    int nulls = 0;
    for (int i = 0; i < field->count; i++) {
        numbers[i] = number_at(field, bytes + i * field->size);
        nulls += field->has_null && numbers[i] == field->null;
    }
    if (field->table != NULL) {
        PyObject *key = PyLong_FromLongLong(numbers[0]);
        PyObject *value =
            key == NULL ? NULL : PyDict_GetItemWithError(field->table, key);
        Py_XDECREF(key);
        return Py_XNewRef(value);
    }
    if (nulls > 0) {
        return nulls == field->count ? Py_NewRef(Py_None) : NULL;
    }
    if (field->unit_tolerance > 0 && !is_unit(field, numbers)) {
        return NULL;
    }
    return field->count == 1 ? value_of(field, numbers[0]) : tuple_of(field, numbers);
}

static PyObject *read_fields(const struct reader *self, const uint8_t *content) {
    PyObject *fields = PyDict_New();
    const uint8_t *at = content + HEADER_SIZE;
    for (Py_ssize_t i = 0; fields != NULL && i < self->count; i++) {
        const struct reader_field *field = &self->fields[i];
        PyObject *value = *at == field->tag ? read_field(field, at + 1) : NULL;
        if (value == NULL || PyDict_SetItem(fields, field->name, value) != 0) {
            Py_CLEAR(fields);
        }
        Py_XDECREF(value);
        at += 1 + field->size * field->count;
    }
    return fields;
}

static PyObject *reader_read(PyObject *object, PyObject *content) {
    const struct reader *self = (const struct reader *)object;
    char *bytes = NULL;
    Py_ssize_t length = 0;
    if (PyBytes_AsStringAndSize(content, &bytes, &length) != 0) {
        return NULL;
    }
    PyObject *fields = NULL;
    if (length == self->size) {
        fields = read_fields(self, (const uint8_t *)bytes);
    }
    if (fields == NULL) {
        return PyErr_Occurred() != NULL ? NULL : Py_NewRef(Py_None);
    }
    const unsigned long sequence = (unsigned long)bytes_at((uint8_t *)bytes + 1, 4);
    const unsigned long time_us = (unsigned long)bytes_at((uint8_t *)bytes + 5, 4);
    return Py_BuildValue("(kkN)", sequence, time_us, fields);
}

// Takes one description; 0 on success.
static int take_field(struct reader_field *field, PyObject *said) {
    PyObject *name = NULL;
    PyObject *table = NULL;
    PyObject *null = NULL;
    if (!PyArg_ParseTuple(said, "OBpiiOppddO", &name, &field->tag, &field->is_signed,
                          &field->size, &field->count, &null, &field->is_scaled,
                          &field->is_divided, &field->by, &field->unit_tolerance,
                          &table)) {
        return -1;
    }
    if (field->size < 1 || field->size > 4 || field->count < 1 ||
        field->count > COUNT_MAX) {
        PyErr_SetString(PyExc_ValueError, "a field of 1 to 16 numbers of 1 to 4 bytes");
        return -1;
    }
    field->has_null = null != Py_None;
    if (field->has_null) {
        field->null = PyLong_AsLongLong(null);
        if (field->null == -1 && PyErr_Occurred() != NULL) {
            return -1;
        }
    }
    field->name = Py_NewRef(name);
    field->table = table == Py_None ? NULL : Py_NewRef(table);
    return 0;
}

static PyObject *reader_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    static char *names[] = {"fields", NULL};
    PyObject *said = NULL;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!:Reader", names, &PyTuple_Type,
                                     &said)) {
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *object = allocate(type, 0);
    if (object == NULL) {
        return NULL;
    }
    struct reader *self = (struct reader *)object;
    const Py_ssize_t count = PyTuple_Size(said);
    self->size = HEADER_SIZE;
    self->fields = PyMem_Calloc((size_t)count + 1, sizeof *self->fields);
    if (self->fields == NULL) {
        Py_DECREF(object);
        return PyErr_NoMemory();
    }
    for (; self->count < count; self->count++) {
        struct reader_field *field = &self->fields[self->count];
        if (take_field(field, PyTuple_GetItem(said, self->count)) != 0) {
            Py_DECREF(object);
            return NULL;
        }
        self->size += 1 + field->size * field->count;
    }
    return object;
}

static int reader_traverse(PyObject *object, visitproc visit, void *arg) {
    const struct reader *self = (const struct reader *)object;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        Py_VISIT(self->fields[i].name);
        Py_VISIT(self->fields[i].table);
    }
    return instance_traverse(object, visit, arg);
}

static void reader_dealloc(PyObject *object) {
    struct reader *self = (struct reader *)object;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        Py_CLEAR(self->fields[i].name);
        Py_CLEAR(self->fields[i].table);
    }
    PyMem_Free(self->fields);
    self->fields = NULL;
    self->count = 0;
    instance_dealloc(object);
}

static PyMethodDef reader_methods[] = {
    {"read", reader_read, METH_O,
     "read($self, content, /)\n--\n\nSequence number, device time in us, and the "
     "fields "
     "by name; None for content that is not plainly right."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot reader_slots[] = {
    {Py_tp_doc,
     "Reader(fields)\n--\n\nReads one kind of message. A field is a tuple: "
     "name, tag, whether signed, bytes of a number, how many numbers, null, "
     "whether scaled, whether divided, by what, the tolerance of a norm, and "
     "a table of values."},
    {Py_tp_new, reader_new},
    {Py_tp_dealloc, reader_dealloc},
    {Py_tp_traverse, reader_traverse},
    {Py_tp_methods, reader_methods},
    {0, NULL},
};

PyType_Spec reader_spec = TYPE("Reader", struct reader, reader_slots);
