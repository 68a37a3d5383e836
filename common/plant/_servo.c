/* The motors' control law; `motor_target` in servo.py says the same in Python. */

#include "common/native.h"

#define JOINTS 27
#define MOTORS 25
#define TERMS 5
#define PARTS 6

/* law(position, velocity, acceleration, torque, stiffness, damping, to_motors, law) fills the law.
 *
 * Six vectors (27,), the means over the joints of each motor as a matrix (27, 25), law (5, 25). */
static PyObject *fill_law(PyObject *module, PyObject *args)
{
    static const char *names[PARTS + 2] = {"position",  "velocity", "acceleration", "torque",
                                           "stiffness", "damping",  "to_motors",    "law"};
    static const Py_ssize_t counts[PARTS + 2] = {JOINTS, JOINTS, JOINTS,          JOINTS,
                                                 JOINTS, JOINTS, JOINTS * MOTORS, TERMS * MOTORS};
    Py_buffer buffers[PARTS + 2];
    double *values[PARTS + 2];
    int held = 0;
    (void)module;
    if (PyTuple_Size(args) != PARTS + 2) {
        PyErr_SetString(PyExc_TypeError, "expected eight arrays");
        return NULL;
    }
    for (; held < PARTS + 2; held++) {
        values[held] = native_doubles(PyTuple_GetItem(args, held), counts[held],
                                      held == PARTS + 1, names[held], &buffers[held]);
        if (values[held] == NULL)
            break;
    }
    if (held == PARTS + 2) {
        const double *position = values[0], *velocity = values[1], *acceleration = values[2];
        const double *torque = values[3], *stiffness = values[4], *damping = values[5];
        double *law = values[PARTS + 1];
        memset(law, 0, sizeof(double) * TERMS * MOTORS);
        for (int j = 0; j < JOINTS; j++) {
            const double kp = stiffness[j], kd = damping[j];
            const double terms[TERMS] = {
                -kp,
                -kd,
                torque[j] + kp * position[j] + kd * velocity[j],
                kp * velocity[j] + kd * acceleration[j],
                0.5 * kp * acceleration[j],
            };
            const double *to_motors = values[PARTS] + MOTORS * j;
            for (int k = 0; k < TERMS; k++)
                for (int m = 0; m < MOTORS; m++)
                    law[MOTORS * k + m] += terms[k] * to_motors[m];
        }
    }
    for (int i = 0; i < held; i++)
        PyBuffer_Release(&buffers[i]);
    if (held < PARTS + 2)
        return NULL;
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"law", fill_law, METH_VARARGS,
     "law(position, velocity, acceleration, torque, stiffness, damping, to_motors, law)"},
    {NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "_servo", "The motors' control law.", -1, methods,
    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit__servo(void) { return native_module(&definition); }
