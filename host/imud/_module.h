// SPDX-License-Identifier: MIT
// What the files of imud._core share: its types, and what all their instances do.
#ifndef MODULE_H
#define MODULE_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

extern PyType_Spec replay_spec;

// An instance of a heap type owns a reference to its type, which is all ours own.
int instance_traverse(PyObject *self, visitproc visit, void *arg);
void instance_dealloc(PyObject *self);

#endif
