// SPDX-License-Identifier: MIT
// _core.Calibrator: the counts of raw messages in physical units, as the probe's filter
// gets them.
#include "inputs.h"

struct calibrator {
    PyObject_HEAD struct calibration calibration;
    struct calibration_scale scale;
    uint16_t gyr_delay_us;
};

static PyObject *calibrator_new(PyTypeObject *type, PyObject *args, PyObject *kwargs) {
    struct sensor_identity identity;
    struct params params;
    struct message_hello hello;
    if (!probe_of_arguments(args, kwargs, "O|O:Calibrator", &identity, &hello,
                            &params)) {
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    PyObject *self = allocate(type, 0);
    if (self != NULL) {
        struct calibrator *calibrator = (struct calibrator *)self;
        calibrator->calibration = params.calibration;
        calibration_scale_of(&identity, &calibrator->scale);
        calibrator->gyr_delay_us = identity.gyr_delay_us;
    }
    return self;
}

static PyObject *vector_of(const struct vector *vector, double one) {
    return Py_BuildValue("(ddd)", vector->axis[0] / one, vector->axis[1] / one,
                         vector->axis[2] / one);
}

static PyObject *calibrator_apply(PyObject *self, PyObject *content) {
    const struct calibrator *calibrator = (const struct calibrator *)self;
    struct sample sample;
    struct measurement measured;
    if (!sample_of_raw(content, &sample)) {
        return NULL;
    }
    calibrate(&calibrator->calibration, &calibrator->scale, &sample, &measured);
    PyObject *acc = vector_of(&measured.acc_m_s2_q21, 0x1p21);
    PyObject *gyr = vector_of(&measured.gyr_rad_s_q25, 0x1p25);
    PyObject *mag =
        measured.has_mag ? vector_of(&measured.mag_ut_q18, 0x1p18) : Py_NewRef(Py_None);
    // Releases all three where one of them is missing.
    return Py_BuildValue("(NNN)", acc, gyr, mag);
}

static PyObject *calibrator_gyr_delay(PyObject *self, PyObject *ignored) {
    (void)ignored;
    return PyLong_FromLong(((const struct calibrator *)self)->gyr_delay_us);
}

static PyMethodDef calibrator_methods[] = {
    {"gyr_delay_us", calibrator_gyr_delay, METH_NOARGS,
     "gyr_delay_us($self, /)\n--\n\nDelay of the gyroscope's low-pass; 0: not known."},
    {"apply", calibrator_apply, METH_O,
     "apply($self, raw, /)\n--\n\nAcceleration in m/s2, rate in rad/s and field in uT "
     "(None: none was read) of a raw message, as the filter of the probe gets them."},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot calibrator_slots[] = {
    {Py_tp_doc, "Calibrator(hello, params=b'')\n--\n\nCalibrates raw messages as the "
                "probe does that sent the hello and has these records in force."},
    {Py_tp_new, calibrator_new},
    {Py_tp_dealloc, instance_dealloc},
    {Py_tp_traverse, instance_traverse},
    {Py_tp_methods, calibrator_methods},
    {0, NULL},
};

PyType_Spec calibrator_spec = TYPE("Calibrator", struct calibrator, calibrator_slots);
