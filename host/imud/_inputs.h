// SPDX-License-Identifier: MIT
// What Python hands over, as the firmware's structs; see _inputs.c.
#ifndef INPUTS_H
#define INPUTS_H

#include "_module.h"

#include "core/drivers/sample.h"
#include "core/drivers/sensor.h"
#include "core/params/params.h"

// The sensor of a hello, and the filter that runs.
bool identity_of_hello(PyObject *content, struct sensor_identity *identity,
                       uint8_t *filter);

// The values of records that the firmware would take.
bool params_of_records(PyObject *records, struct params *params);

bool sample_of_raw(PyObject *content, struct sample *sample);

#endif
