// SPDX-License-Identifier: MIT
// Shared by the C files of imud._core: types, and functions of all their instances.
#ifndef MODULE_H
#define MODULE_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

// A type of the module whose instances the collector knows.
#define TYPE(type_name, instance, type_slots)                                          \
    {                                                                                  \
        .name = "imud._core." type_name, .basicsize = sizeof(instance),                \
        .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,   \
        .slots = (type_slots)                                                          \
    }

extern PyType_Spec calibrator_spec;
extern PyType_Spec chunk_spec;
extern PyType_Spec line_spec;
extern PyType_Spec reader_spec;
extern PyType_Spec replay_spec;
extern PyType_Spec rising_spec;

// A function of the module.
PyObject *core_estimate(PyObject *module, PyObject *args);

// For types whose instances own no Python object but the reference to their type.
int instance_traverse(PyObject *self, visitproc visit, void *arg);
void instance_dealloc(PyObject *self);

#endif
