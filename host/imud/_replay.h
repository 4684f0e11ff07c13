// SPDX-License-Identifier: MIT
// The type _core.Replay, for the module to add.
#ifndef REPLAY_H
#define REPLAY_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

extern PyType_Spec replay_spec;

#endif
