// SPDX-License-Identifier: MIT
// What Python hands over, as the firmware's structs; see inputs.c.
#ifndef INPUTS_H
#define INPUTS_H

#include "module.h"

#include "core/drivers/sample.h"
#include "core/drivers/sensor.h"
#include "core/params/params.h"
#include "core/wire/messages.h"

// The arguments (hello, params=b"") of a type: the hello, the sensor that it tells of,
// and the values of the records. `format`: as of PyArg_ParseTuple.
bool probe_of_arguments(PyObject *args, PyObject *kwargs, const char *format,
                        struct sensor_identity *identity, struct message_hello *hello,
                        struct params *params);

// The values of records that the firmware would take.
bool params_of_records(PyObject *records, struct params *params);

bool sample_of_raw(PyObject *content, struct sample *sample);

#endif
